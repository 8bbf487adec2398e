//! A body that gives documents by distance.
//!
//! Asked for `{nearest_to: [x, y, z], limit: N, max_distance: D, …}`, it takes
//! the documents with a position that match the rest of the query, and gives the
//! nearest, nearest first, each with its `distance` in the unit of the positions.
//! `limit` and `max_distance` may be left out. A position is `[x, y, z]`,
//! `[x, y]` or `{x, y, z}`; of a point with two coordinates, distance is in the
//! plane. Positions are compared as they are: ask for one frame.

use bson::raw::RawBsonRef;
use bson::{Bson, Document, RawDocument, RawDocumentBuf, doc};

use super::body::{Asked, Body, Builtin, ComputeError, Options, WrongOption};
use crate::formats::scene::document::finite as number;
use crate::formats::shell;
use crate::query::QueryError;
use crate::store::{Find, Namespace, StoreError};

/// The keys of the query that are parameters.
const OWN: [&str; 4] = ["nearest_to", "limit", "max_distance", "distance"];

/// How many documents are held beside those that are asked for.
const HELD: usize = 1_000;

/// The builtin body. `position` is the dotted key of the position (default: `translation`).
pub(super) const BUILTIN: Builtin = Builtin { name: "nearest", keys: &["position"], make };

fn make(options: &Options, _: &Namespace) -> Result<Box<dyn Body>, WrongOption> {
    let position = options.get("position").map_or("translation", String::as_str);
    if position.split('.').any(str::is_empty) {
        return Err(("position", format!("`{position}` is not a key; expected one like `pose.translation`")));
    }
    Ok(Box::new(Nearest { position: position.to_owned() }))
}

/// Documents by distance.
struct Nearest {
    position: String,
}

/// What is asked for.
struct Wanted {
    point: Vec<f64>,
    limit: usize,
    max_distance: f64,
}

impl Body for Nearest {
    fn compute(&self, asked: &Asked<'_>) -> Result<Vec<Document>, ComputeError> {
        let wanted = Wanted::read(asked.query).map_err(ComputeError::wrong)?;
        let mut filter = doc! { "$nor": [{ "nearest_to": { "$exists": true } }] };
        let rest = asked.query.iter().filter(|(key, _)| !OWN.contains(&key.as_str()));
        filter.extend(rest.map(|(key, value)| (key.clone(), value.clone())));
        let mut near: Vec<(f64, RawDocumentBuf)> = Vec::new();
        let keep_nearest = |near: &mut Vec<(f64, RawDocumentBuf)>| {
            // Of those at one distance, the first ones: the sort is stable.
            near.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            near.truncate(wanted.limit);
        };
        for document in asked.memory.find(asked.namespace, &Find { filter, ..Find::default() })? {
            let document = document?;
            let Some(position) = lookup(&document, &self.position).map_err(damaged)? else { continue };
            let Some(distance) = distance(&position, &wanted.point) else {
                return Err(self.wrong(&decoded(&document)?, &wanted));
            };
            if distance <= wanted.max_distance {
                near.push((distance, document));
            }
            if near.len() / 2 > wanted.limit.saturating_add(HELD) {
                keep_nearest(&mut near);
            }
        }
        keep_nearest(&mut near);
        near.iter().map(|(distance, document)| Ok(answer(decoded(document)?, *distance, asked.query))).collect()
    }

    fn sources(&self, asked: &Namespace) -> Vec<Namespace> {
        vec![asked.clone()]
    }

    fn describe(&self) -> String {
        format!("nearest, with positions under {}", self.position)
    }
}

impl Nearest {
    fn wrong(&self, document: &Document, wanted: &Wanted) -> ComputeError {
        let id = document.get("_id").map(shell::relaxed_value).unwrap_or_default();
        let count = wanted.point.len();
        ComputeError::wrong(format!(
            "the `{}` of the document with _id {id} is not a position of {count} numbers, as `nearest_to` is",
            self.position
        ))
    }
}

impl Wanted {
    fn read(query: &Document) -> Result<Self, String> {
        let point = query.get("nearest_to").and_then(coordinates).filter(|point| (2..=3).contains(&point.len()));
        let limit = match query.get("limit") {
            None => Some(usize::MAX),
            Some(limit) => {
                number(limit).filter(|limit| *limit >= 0.0 && limit.fract() == 0.0).map(|limit| limit as usize)
            }
        };
        let max_distance = match query.get("max_distance") {
            None => Some(f64::INFINITY),
            Some(distance) => number(distance).filter(|distance| *distance >= 0.0),
        };
        Ok(Self {
            point: point.ok_or("its `nearest_to` has to be a point, [x, y, z] or [x, y]")?,
            limit: limit.ok_or("its `limit` has to be a whole number of documents")?,
            max_distance: max_distance.ok_or("its `max_distance` has to be a number, not negative")?,
        })
    }
}

/// The document with its distance, as the query matches it.
fn answer(mut document: Document, distance: f64, query: &Document) -> Document {
    document.remove("_id");
    for key in ["nearest_to", "limit", "max_distance"] {
        if let Some(value) = query.get(key) {
            document.insert(key, value.clone());
        }
    }
    document.insert("distance", distance);
    document
}

fn lookup(document: &RawDocument, path: &str) -> Result<Option<Bson>, bson::error::Error> {
    let (first, rest) = path.split_once('.').map_or((path, None), |(first, rest)| (first, Some(rest)));
    match (document.get(first)?, rest) {
        (Some(value), None) => Ok(Some(Bson::try_from(value)?)),
        (Some(RawBsonRef::Document(inner)), Some(rest)) => lookup(inner, rest),
        _ => Ok(None),
    }
}

fn decoded(document: &RawDocument) -> Result<Document, StoreError> {
    Document::try_from(document).map_err(damaged)
}

fn damaged(error: bson::error::Error) -> StoreError {
    QueryError::from(error).into()
}

/// The distance of a position to a point, in as many dimensions as the point has.
fn distance(position: &Bson, point: &[f64]) -> Option<f64> {
    let position = coordinates(position).filter(|position| position.len() >= point.len())?;
    Some(position.iter().zip(point).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt())
}

fn coordinates(value: &Bson) -> Option<Vec<f64>> {
    match value {
        Bson::Array(values) => values.iter().map(number).collect(),
        Bson::Document(fields) => {
            let named = ["x", "y", "z"].into_iter().map_while(|name| fields.get(name));
            named.map(number).collect::<Option<Vec<_>>>().filter(|values| values.len() >= 2)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distance_has_as_many_dimensions_as_the_point() {
        let position = Bson::from(vec![3.0, 4.0, 12.0]);
        assert_eq!(distance(&position, &[0.0, 0.0, 0.0]), Some(13.0));
        assert_eq!(distance(&position, &[0.0, 0.0]), Some(5.0));
        assert_eq!(distance(&doc! { "x": 3, "y": 4_i64 }.into(), &[0.0, 0.0]), Some(5.0));
        assert_eq!(distance(&doc! { "x": 3, "y": 4 }.into(), &[0.0, 0.0, 0.0]), None);
        assert_eq!(distance(&Bson::from("here"), &[0.0, 0.0]), None);
    }

    #[test]
    fn parameters_are_checked() {
        for query in [
            doc! { "nearest_to": [1] },
            doc! { "nearest_to": "A" },
            doc! { "nearest_to": [0, 0], "limit": 1.5 },
            doc! { "nearest_to": [0, 0], "limit": -1 },
            doc! { "nearest_to": [0, 0], "max_distance": "far" },
        ] {
            assert!(Wanted::read(&query).is_err(), "{query}");
        }
        assert!(Wanted::read(&doc! { "nearest_to": [0, 0, 0], "limit": 3_i64, "max_distance": 0.5 }).is_ok());
    }
}
