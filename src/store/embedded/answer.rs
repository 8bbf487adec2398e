//! Answering queries: find, count, distinct.

use std::sync::Arc;

use bson::{Bson, Document, doc};

use super::Embedded;
use super::catalog::Collection;
use super::indexed::decay;
use super::scan::{Found, Scan, sharpen};
use super::search::{scored, unscored};
use super::snapshot::Snapshot;
use super::verbs::collated;
use crate::query::collation::during;
use crate::query::{self, Distinct, Filter, QueryError, Sort, Spill};
use crate::store::parsed::Parsed;
use crate::store::{Documents, Find, Modifiers, Namespace, Query, StoreError, Values, metadata};

impl Embedded {
    /// The documents that match, the first of which are read in the snapshot.
    pub(super) fn answer(
        &self,
        snapshot: Snapshot<'_>,
        ns: &Namespace,
        find: &Find,
    ) -> Result<Documents<'_>, StoreError> {
        let collection = self.collection(ns)?;
        let collation = self.collation(collection, &find.modifiers)?;
        Ok(collated(during(collation.as_ref(), || self.answer_in(snapshot, collection, find))?, collation))
    }

    fn answer_in(
        &self,
        snapshot: Snapshot<'_>,
        collection: Option<Collection>,
        find: &Find,
    ) -> Result<Documents<'_>, StoreError> {
        let mut parsed = Parsed::of(find)?;
        let Some(collection) = collection else { return Ok(Box::new(std::iter::empty())) };
        let scan = Scan::sorted(self, collection, &mut parsed.filter, &parsed.sort, find.into())?;
        let keys = find.keys.return_key.then(|| self.keys_read(collection, &scan)).transpose()?;
        let is_sorted = scan.in_order();
        let scan = if is_sorted { scan.at_most(parsed.most()) } else { scan };
        let scan = scan.shared().begun()?;
        drop(snapshot);
        let (is_scored, filter) = (parsed.is_scored, Arc::clone(&parsed.filter));
        let matches: Documents<'_> = match find.keys.show_record_id && keys.is_none() {
            false => Box::new(scan.map(|found| found.map(|found| found.body))),
            true => Box::new(scan.map(|found| found.map(Found::with_position))),
        };
        let matches = if is_scored { scored(matches, filter) } else { matches };
        let answer = parsed.answer(matches, is_sorted)?;
        let answer = if is_scored { unscored(answer) } else { answer };
        Ok(match keys {
            Some(keys) => Box::new(answer.map(move |document| keys.of(&document?))),
            None => answer,
        })
    }

    /// Answers a query to explain how it is answered.
    pub(super) fn explained(&self, ns: &Namespace, find: &Find) -> Result<Document, StoreError> {
        let collection = self.collection(ns)?;
        during(self.collation(collection, &find.modifiers)?.as_ref(), || self.explained_in(collection, find))
    }

    fn explained_in(&self, collection: Option<Collection>, find: &Find) -> Result<Document, StoreError> {
        let Parsed { mut filter, sort, .. } = Parsed::of(find)?;
        let Some(collection) = collection else {
            return Ok(doc! { "index": Bson::Null, "keys_examined": 0, "documents_examined": 0, "returned": 0 });
        };
        let (scan, mut explanation) = Scan::explained(self, collection, &mut filter, &sort, find.into())?;
        let (examined, is_sorted) = (scan.examined(), scan.in_order());
        let (skip, limit) = (count(find.skip), if find.limit == 0 { usize::MAX } else { count(find.limit) });
        let most = if is_sorted { skip.saturating_add(limit) } else { usize::MAX };
        let mut matches = 0usize;
        for found in scan.at_most(most).take(most) {
            found?;
            matches += 1;
        }
        if !find.sort.is_empty() {
            explanation.insert("sort", if is_sorted { "index" } else { "memory" });
        }
        let returned = matches.saturating_sub(skip).min(limit);
        let numbers = [
            ("keys_examined", examined.keys.get()),
            ("documents_examined", examined.documents.get()),
            ("returned", returned as u64),
        ];
        explanation.extend(numbers.map(|(name, number)| (name.to_owned(), number.cast_signed().into())));
        Ok(explanation)
    }

    pub(super) fn tally(&self, ns: &Namespace, query: Query<'_>) -> Result<u64, StoreError> {
        let collection = self.collection(ns)?;
        during(self.collation(collection, query.modifiers)?.as_ref(), || self.tally_in(collection, query))
    }

    fn tally_in(&self, collection: Option<Collection>, query: Query<'_>) -> Result<u64, StoreError> {
        let mut filter = Arc::new(with_variables(query.filter, query.modifiers)?);
        let Some(collection) = collection else { return Ok(0) };
        if let hint @ Some(_) = query.modifiers.hint.as_ref() {
            return Scan::sorted(self, collection, &mut filter, &Sort::none(), hint.into())?.count();
        }
        let indexes = self.indexes_of(collection)?;
        sharpen(&indexes, &mut filter);
        let size = || collection.size(&self.connection).map_err(|e| self.explain(&e));
        match (decay(&indexes), filter.not_before(metadata::DECAY_PATH)) {
            _ if filter.matches_all() => size(),
            (Some(index), Some(date)) => Ok(size()?.saturating_sub(self.decayed(index, date)?)),
            _ => Scan::new(self, collection, &mut filter)?.count(),
        }
    }

    pub(super) fn distinct_values(&self, ns: &Namespace, field: &str, query: Query<'_>) -> Result<Values, StoreError> {
        let collection = self.collection(ns)?;
        let collation = self.collation(collection, query.modifiers)?;
        during(collation.as_ref(), || self.values_in(collection, field, query))
    }

    fn values_in(&self, collection: Option<Collection>, field: &str, query: Query<'_>) -> Result<Values, StoreError> {
        check_path(field)?;
        let mut filter = Arc::new(with_variables(query.filter, query.modifiers)?);
        let values = Distinct::new(field, &Spill::default())?;
        let Some(collection) = collection else { return Ok(Box::new(std::iter::empty())) };
        let found = Scan::sorted(self, collection, &mut filter, &Sort::none(), query.modifiers.hint.as_ref().into())?;
        let values = values.of(found.shared().map(|found| found.map(|found| found.body)))?;
        Ok(Box::new(values.map(|value| Ok(value?))))
    }
}

/// Reads a filter whose expressions may use the variables of the command.
pub(super) fn with_variables(filter: &Document, modifiers: &Modifiers) -> Result<Filter, QueryError> {
    match modifiers.variables.is_empty() {
        true => Filter::parse(filter),
        false => Filter::parse_with_constants(filter, &query::constants(&modifiers.variables)?),
    }
}

fn count(number: u64) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}

/// Refuses paths that MongoDB refuses to list the values of.
fn check_path(path: &str) -> Result<(), QueryError> {
    if path.is_empty() {
        return Err(QueryError::invalid(40_352, "the field's path is empty"));
    }
    for name in path.split('.') {
        if name.is_empty() {
            return Err(QueryError::invalid(15_998, format!("the path `{path}` has an empty field name")));
        }
        if name.starts_with('$') && !["$id", "$ref", "$db"].contains(&name) {
            return Err(
                QueryError::invalid(16_410, format!("the field name `{name}` may not start with `$`")).about(name)
            );
        }
    }
    Ok(())
}
