//! `$geoNear`: documents by their distance from a point, with the distance.

use bson::{Bson, Document, RawDocumentBuf};

use super::documents::{Documents, encode};
use super::run::Run;
use super::unwind::put;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::filter::{Context, Filter, Parser};
use crate::query::geo::{Centre, Near, distance_of};
use crate::query::number::Number;

/// The most parts of a path that values are put at, for a document may not be deeper.
const MAX_PARTS: usize = 199;

/// A compiled `$geoNear`.
#[derive(Debug)]
pub(super) struct GeoNear {
    near: Near,
    query: Filter,
    /// Where the distance is put.
    distance: Vec<String>,
    /// Where the place is put that is so far off.
    place: Option<Vec<String>>,
    multiplier: f64,
}

impl GeoNear {
    /// Reads the stage. `key`, the path of the places, is needed: a store that knows its
    /// indexes fills it in where the user leaves it out.
    pub(super) fn parse(argument: &Bson, scope: &Scope) -> Result<Self> {
        let spec = match argument {
            Bson::Document(spec) => spec.clone(),
            Bson::Array(_) => Document::new(),
            _ => return Err(QueryError::invalid(10_065, "$geoNear needs an object")),
        };
        let near = spec.get("near").ok_or_else(|| QueryError::invalid(5_860_400, "$geoNear needs 'near', a point"))?;
        let distance = match spec.get("distanceField") {
            Some(Bson::String(path)) => target(path)?,
            _ => return Err(QueryError::invalid(16_606, "$geoNear needs a 'distanceField', a string")),
        };
        let place = match spec.get("includeLocs") {
            None => None,
            Some(Bson::String(path)) => Some(target(path)?),
            Some(_) => return Err(QueryError::invalid(16_607, "the 'includeLocs' of $geoNear must be a string")),
        };
        let multiplier = match spec.get("distanceMultiplier") {
            None => 1.0,
            Some(value) => non_negative("distanceMultiplier", value)?,
        };
        let query = match spec.get("query") {
            None => Filter::parse_with(&Document::new(), &Parser::with_scope(scope))?,
            Some(Bson::Document(query)) => Filter::parse_with(query, &Parser::with_scope(scope).of_stage(false))?,
            Some(_) => return Err(QueryError::type_mismatch("the 'query' of $geoNear must be an object")),
        };
        let limit = |name: &str, default: f64| match spec.get(name) {
            None => Ok(default),
            Some(value) => {
                let value = constant(name, value, scope)?;
                if Number::of(&value).is_none() {
                    return Err(QueryError::type_mismatch(format!("the '{name}' of $geoNear must be a number")));
                }
                distance_of(name, &value)
            }
        };
        let (least, most) = (limit("minDistance", 0.0)?, limit("maxDistance", f64::INFINITY)?);
        let spherical = spec.get("spherical").is_some_and(is_true);
        let near = constant("near", near, scope)?;
        let centre = match &near {
            Bson::Document(_) | Bson::Array(_) => Centre::parse((&near).into(), spherical)?,
            _ => return Err(QueryError::invalid(5_860_401, "the 'near' of $geoNear must be a point")),
        };
        let near = Near::new(&key(&spec)?, centre, least, most)?;
        Ok(Self { near, query, distance, place, multiplier })
    }

    /// What is asked for.
    pub(super) fn near(&self) -> &Near {
        &self.near
    }

    pub(super) fn run<E: From<QueryError>>(
        &self,
        input: Documents<'_, E>,
        run: &Run<'_, E>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        let mut placed: Vec<(f64, RawDocumentBuf)> = Vec::new();
        for document in input {
            let document = document?;
            let mut context = Context { now: Some(run.now), variables: Some(&run.variables), ..Context::default() };
            if !self.query.matches_with((&*document).into(), &mut context)? {
                continue;
            }
            let Some((distance, place)) = self.near.nearest((&*document).into()) else { continue };
            let place = place.to_bson();
            let mut document = Document::try_from(document).map_err(QueryError::from)?;
            put(&mut document, &self.distance, Bson::Double(distance * self.multiplier));
            if let Some(path) = &self.place {
                put(&mut document, path, place);
            }
            placed.push((distance, encode(&document)?));
        }
        placed.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(placed.into_iter().map(|(_, document)| document).collect())
    }
}

fn is_true(value: &Bson) -> bool {
    crate::query::view::View::from(value).truthy()
}

/// Returns a value that does not depend on documents.
fn constant(name: &str, value: &Bson, scope: &Scope) -> Result<Bson> {
    match Expression::parse_in(value, scope)? {
        Expression::Constant(value) => Ok(value.unwrap_or(Bson::Null)),
        _ => Err(QueryError::invalid(5_860_402, format!("the '{name}' of $geoNear must be a constant"))),
    }
}

fn non_negative(name: &str, value: &Bson) -> Result<f64> {
    match Number::of(value).map(Number::to_double) {
        Some(number) if number >= 0.0 => Ok(number),
        Some(_) => Err(QueryError::bad_value(format!("the '{name}' of $geoNear must not be negative"))),
        None => Err(QueryError::type_mismatch(format!("the '{name}' of $geoNear must be a number"))),
    }
}

/// Where documents have their places.
fn key(spec: &Document) -> Result<String> {
    match spec.get("key") {
        Some(Bson::String(path)) if path.is_empty() => {
            Err(QueryError::bad_value("the 'key' of $geoNear cannot be empty"))
        }
        Some(Bson::String(path)) => target(path).map(|_| path.clone()),
        Some(_) => Err(QueryError::type_mismatch("the 'key' of $geoNear must be a string")),
        None => Err(QueryError::bad_value("$geoNear needs a 'key' here: the path of the places")),
    }
}

/// Returns a path that something is put at.
fn target(path: &str) -> Result<Vec<String>> {
    let parts: Vec<String> = path.split('.').map(str::to_owned).collect();
    if path.is_empty() {
        return Err(QueryError::invalid(40_352, "a path of $geoNear is empty"));
    }
    if parts.len() > MAX_PARTS {
        return Err(QueryError::bad_value("a path of $geoNear is too long"));
    }
    if parts.iter().any(|part| part.is_empty() || part.starts_with('$') || part.contains('\0')) {
        return Err(QueryError::invalid(16_410, format!("the path '{path}' of $geoNear is not valid")));
    }
    Ok(parts)
}
