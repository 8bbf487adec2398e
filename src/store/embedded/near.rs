//! `$near` and `$geoNear`: answered by a scan, but only with a geospatial index, as in MongoDB.

use std::sync::Arc;

use bson::{Bson, Document, doc};

use super::Embedded;
use super::access::{Chosen, Way};
use super::catalog::Collection;
use super::indexed::{Indexed, Indexes};
use super::scan::Scan;
use crate::query::{Filter, Near, QueryError, Sort, is_empty_match};
use crate::store::{Namespace, StoreError};

/// MongoDB's code for a query that no index answers which needs one.
const NO_PLAN: i32 = 291;

impl Embedded {
    /// The way to the documents that match, the nearest first: they are measured all.
    pub(super) fn by_distance(
        &self,
        collection: Collection,
        indexes: &Indexes,
        filter: &Arc<Filter>,
        near: &Near,
        sort: &Sort,
    ) -> Result<Chosen, StoreError> {
        let index = self.check_near(collection, near)?;
        let candidates = self.choose(collection, indexes, filter, &Sort::none(), false)?;
        let mut placed = Vec::new();
        for found in Scan::along(self, collection, filter, candidates)? {
            let found = found?;
            placed.extend(near.distance(&found.body).map(|distance| (distance, found.position)));
        }
        placed.sort_by(|a, b| a.0.total_cmp(&b.0));
        let positions = placed.into_iter().map(|(_, position)| position).collect();
        let explanation = doc! { "index": index, "near": near.path() };
        Ok(Chosen { way: Way::Positions(positions, Vec::new()), is_sorted: sort.is_empty(), explanation, keys: 0 })
    }

    /// Checks that there is an index which MongoDB could answer with, and gives its name.
    ///
    /// # Errors
    /// Where there is none, or the point is outside of its bounds.
    pub(super) fn check_near(&self, collection: Collection, near: &Near) -> Result<String, StoreError> {
        let indexes = self.indexes_of(collection)?;
        let mut able = indexes.iter().filter(|index| {
            index.definition.keys.get(near.path()).and_then(Bson::as_str).is_some_and(|kind| near.is_answered_by(kind))
        });
        match able.next() {
            Some(index) => {
                index.pattern.check_centre(near)?;
                Ok(index.definition.name.clone())
            }
            None => Err(QueryError::invalid(NO_PLAN, no_index(near)).into()),
        }
    }

    /// The stages, with the path of a `$geoNear` in front, also in those of `$lookup` and
    /// `$unionWith`, filled in from the only index there is.
    pub(super) fn with_near_key(&self, ns: &Namespace, stages: &[Document]) -> Result<Vec<Document>, StoreError> {
        let mut stages = stages.to_vec();
        for (name, spec) in stages.iter_mut().flat_map(|stage| stage.iter_mut()) {
            let Bson::Document(spec) = spec else { continue };
            let other = match name.as_str() {
                "$lookup" => spec.get_str("from"),
                "$unionWith" => spec.get_str("coll"),
                _ => continue,
            };
            if let (Ok(collection), Ok(inner)) = (other, spec.get_array("pipeline")) {
                let other = Namespace { database: ns.database.clone(), collection: collection.to_owned() };
                let inner: Option<Vec<Document>> = inner.iter().map(|stage| stage.as_document().cloned()).collect();
                if let Some(inner) = inner {
                    spec.insert("pipeline", self.with_near_key(&other, &inner)?);
                }
            }
        }
        let first = stages.iter_mut().find(|stage| !is_empty_match(stage));
        let Some(Bson::Document(spec)) = first.and_then(|stage| stage.get_mut("$geoNear")) else {
            return Ok(stages);
        };
        let Some(collection) = self.collection(ns)? else {
            let message = format!("$geoNear needs an index, but there is no collection {ns}");
            return Err(QueryError::invalid(QueryError::NAMESPACE_NOT_FOUND, message).about("$geoNear").into());
        };
        if !spec.contains_key("key") {
            spec.insert("key", only_place(&self.indexes_of(collection)?)?);
        }
        Ok(stages)
    }
}

fn no_index(near: &Near) -> String {
    let (path, kind) = (near.path(), near.index_type());
    format!(
        "unable to find an index for what is near {path}: make one, like `rmem index NS \"{{'{path}': '{kind}'}}\"`"
    )
}

/// The path of the only geospatial index; one of the plane is asked first, as MongoDB does.
fn only_place(indexes: &[Indexed]) -> Result<String, QueryError> {
    for kind in ["2d", "2dsphere"] {
        let paths: Vec<&String> = indexes
            .iter()
            .flat_map(|index| &index.definition.keys)
            .filter(|(_, direction)| direction.as_str() == Some(kind))
            .map(|(path, _)| path)
            .collect();
        match paths.as_slice() {
            [] => {}
            [path] => return Ok((*path).clone()),
            _ => {
                let message =
                    format!("there is more than one {kind} index: say with `key` which path $geoNear is about");
                return Err(QueryError::invalid(QueryError::INDEX_NOT_FOUND, message).about("$geoNear"));
            }
        }
    }
    let message = "$geoNear needs a 2d or 2dsphere index: make one, like `rmem index NS \"{pos: '2dsphere'}\"`";
    Err(QueryError::invalid(QueryError::INDEX_NOT_FOUND, message).about("$geoNear"))
}
