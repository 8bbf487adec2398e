//! What a pipeline takes from the asked query: `$$query` and `$$query.KEY`.
//!
//! In an expression it is what a variable of that name would be: the value, or
//! nothing where the query has no such key. Where a stage has no expressions (a
//! filter, `$limit`, `$sort` and the like) it stands for the value as it is, so
//! that `{$match: {size: '$$query.size'}}` also takes a `{$gt: 3}`; what the
//! query does not have cannot be asked for then.

use bson::{Bson, Document, doc};

use super::body::ComputeError;
use crate::formats::shell;
use crate::query::QueryError;

/// The variable.
const QUERY: &str = "$$query";
/// What is no expression, unless `$expr` makes it one.
const PLAIN: [&str; 7] = ["$match", "$geoNear", "$limit", "$skip", "$sort", "$sample", "restrictSearchWithMatch"];

/// The pipeline with the values of the query.
///
/// # Errors
/// Where a filter takes a value that the query does not have.
pub(super) fn bind(stages: &[Document], query: &Document) -> Result<Vec<Document>, ComputeError> {
    stages.iter().map(|stage| bind_document(stage, query, false)).collect()
}

fn bind_document(document: &Document, query: &Document, is_plain: bool) -> Result<Document, ComputeError> {
    let pairs = document.iter().map(|(key, value)| {
        let value = match key.as_str() {
            "$literal" => value.clone(),
            "$expr" => bind_value(value, query, false)?,
            key => bind_value(value, query, is_plain || PLAIN.contains(&key))?,
        };
        Ok((key.clone(), value))
    });
    pairs.collect()
}

fn bind_value(value: &Bson, query: &Document, is_plain: bool) -> Result<Bson, ComputeError> {
    Ok(match value {
        Bson::Document(document) => bind_document(document, query, is_plain)?.into(),
        Bson::Array(values) => {
            let values = values.iter().map(|value| bind_value(value, query, is_plain));
            Bson::Array(values.collect::<Result<_, _>>()?)
        }
        Bson::String(text) => match (variable(text), is_plain) {
            (None, _) => value.clone(),
            (Some(path), false) => {
                found(query, path).map_or("$$REMOVE".into(), |value| doc! { "$literal": value }.into())
            }
            (Some(path), true) => found(query, path).ok_or_else(|| missing(query, path))?,
        },
        other => other.clone(),
    })
}

/// The path that a variable of the query has: empty for the query itself.
fn variable(text: &str) -> Option<&str> {
    let rest = text.strip_prefix(QUERY)?;
    if rest.is_empty() { Some(rest) } else { rest.strip_prefix('.') }
}

fn found(query: &Document, path: &str) -> Option<Bson> {
    if path.is_empty() { Some(query.clone().into()) } else { lookup(query, path).cloned() }
}

/// The value of a path, whose parts may themselves be keys with dots, as those of queries are.
fn lookup<'a>(document: &'a Document, path: &str) -> Option<&'a Bson> {
    let below = |(dot, _): (usize, &str)| {
        let (first, rest) = (path.get(..dot)?, path.get(dot + 1..)?);
        lookup(document.get(first)?.as_document()?, rest)
    };
    document.get(path).or_else(|| path.match_indices('.').find_map(below))
}

fn missing(query: &Document, path: &str) -> ComputeError {
    let query = shell::relaxed(query);
    QueryError::bad_value(format!(
        "its pipeline takes `{QUERY}.{path}` for a filter, and the query {query} has no `{path}`; \
         let the spec ask for it, with {{'{path}': {{$exists: true}}}}"
    ))
    .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bound(stage: Document, query: Document) -> Document {
        bind(&[stage], &query).unwrap().remove(0)
    }

    #[test]
    fn an_expression_takes_the_value_of_the_query() {
        let stage =
            doc! { "$project": { "x": { "$add": ["$x", "$$query.a.b"] }, "all": "$$query", "price": "$$queryx" } };
        let query = doc! { "a": { "b": "$y" } };
        let expected = doc! { "$project": {
            "x": { "$add": ["$x", { "$literal": "$y" }] }, "all": { "$literal": query.clone() }, "price": "$$queryx",
        } };
        assert_eq!(bound(stage.clone(), query), expected);
        let without = bound(stage, doc! {});
        assert_eq!(
            without.get_document("$project").unwrap().get_document("x").unwrap(),
            &doc! { "$add": ["$x", "$$REMOVE"] }
        );
        let literal = doc! { "$set": { "x": { "$literal": "$$query.a" } } };
        assert_eq!(bound(literal.clone(), doc! { "a": 1 }), literal);
    }

    #[test]
    fn a_filter_takes_it_as_it_is() {
        let stage = doc! { "$match": { "size": "$$query.size", "$expr": { "$eq": ["$x", "$$query.pose.x"] } } };
        let query = doc! { "size": { "$gt": 3 }, "pose.x": 7 };
        let expected = doc! { "$match": { "size": { "$gt": 3 }, "$expr": { "$eq": ["$x", { "$literal": 7 }] } } };
        assert_eq!(bound(stage, query.clone()), expected);
        let inner = doc! { "$lookup": { "from": "x", "pipeline": [{ "$limit": "$$query.pose.x" }], "as": "x" } };
        assert_eq!(bound(inner, query), doc! { "$lookup": { "from": "x", "pipeline": [{ "$limit": 7 }], "as": "x" } });
        let wrong = bind(&[doc! { "$match": { "size": "$$query.size" } }], &doc! { "x": 1 }).unwrap_err();
        assert!(wrong.to_string().contains("the query {\"x\":1} has no `size`"), "{wrong}");
    }
}
