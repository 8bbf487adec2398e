//! What a filter says for sure about a document: the start of an upserted one.

use bson::{Bson, Document};

use crate::query::error::{QueryError, Result};
use crate::query::filter::is_operators;

/// A document of the filter's equalities.
pub(super) fn equalities(filter: &Document) -> Result<Document> {
    let mut found = Vec::new();
    collect(filter, &mut found, 0)?;
    let mut document = Document::new();
    for (path, value) in found {
        if path == "_id" && document.contains_key("_id") {
            return Err(twice("_id"));
        }
        let parts: Vec<&str> = path.split('.').collect();
        put(&mut document, &parts, value.clone(), &path)?;
    }
    Ok(document)
}

fn collect(filter: &Document, found: &mut Vec<(String, Bson)>, depth: usize) -> Result<()> {
    if depth > 100 {
        return Err(QueryError::bad_value("the filter is nested too deeply"));
    }
    for (name, value) in filter {
        match (name.as_str(), value) {
            ("$and", Bson::Array(items)) => {
                for item in items.iter().filter_map(Bson::as_document) {
                    collect(item, found, depth + 1)?;
                }
            }
            ("$or", Bson::Array(items)) if items.len() == 1 => {
                for item in items.iter().filter_map(Bson::as_document) {
                    collect(item, found, depth + 1)?;
                }
            }
            (name, _) if name.starts_with('$') => {}
            (name, Bson::Document(operators)) if is_operators(operators.into()) => {
                if let Some(value) = equality(operators) {
                    found.push((name.to_owned(), value.clone()));
                }
            }
            (_, Bson::RegularExpression(_)) => {}
            (name, value) => found.push((name.to_owned(), value.clone())),
        }
    }
    Ok(())
}

fn equality(operators: &Document) -> Option<&Bson> {
    operators.iter().find_map(|(name, value)| match (name.as_str(), value) {
        ("$eq", value) => Some(value),
        ("$in" | "$all", Bson::Array(items)) => match items.as_slice() {
            [Bson::Document(only)] if is_operators(only.into()) => None,
            [Bson::RegularExpression(_)] => None,
            [only] => Some(only),
            _ => None,
        },
        _ => None,
    })
}

fn put(document: &mut Document, parts: &[&str], value: Bson, path: &str) -> Result<()> {
    let Some((name, rest)) = parts.split_first() else { return Ok(()) };
    if rest.is_empty() {
        if document.contains_key(name) {
            return Err(twice(path));
        }
        document.insert(*name, value);
        return Ok(());
    }
    match document.entry(*name).or_insert_with(|| Bson::Document(Document::new())) {
        Bson::Document(inner) => put(inner, rest, value, path),
        _ => Err(twice(path)),
    }
}

fn twice(path: &str) -> QueryError {
    QueryError::invalid(54, format!("cannot infer query fields to set, path '{path}' is matched twice"))
}
