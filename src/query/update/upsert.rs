//! The equalities of a filter, which an upserted document starts with.

use bson::{Bson, Document};

use crate::query::compare::equal_values as equal;
use crate::query::dollar::is_operators;
use crate::query::error::{QueryError, Result};
use crate::query::filter::check_upsert;

/// Returns a document of the filter's equalities.
pub(super) fn equalities(filter: &Document, only_id: bool) -> Result<Document> {
    check_upsert(filter)?;
    let mut found = Vec::new();
    if is_never_true(filter) {
        return Ok(Document::new());
    }
    collect(filter, &mut found, 0)?;
    // In the order of their paths.
    found.sort_by(|a, b| a.0.cmp(&b.0));
    let mut document = Document::new();
    let mut whole: Vec<String> = Vec::new();
    for (path, value) in found {
        if only_id && path != "_id" && !path.starts_with("_id.") {
            continue;
        }
        if path == "_id" && document.contains_key("_id") {
            return Err(twice("_id"));
        }
        let is_inside = |outer: &String| path.strip_prefix(outer.as_str()).is_some_and(|rest| rest.starts_with('.'));
        if whole.iter().any(is_inside) {
            return Err(twice(&path));
        }
        let parts: Vec<&str> = path.split('.').collect();
        put(&mut document, &parts, value.clone(), &path)?;
        whole.push(path);
    }
    Ok(document)
}

/// Returns whether a filter has a condition that nothing meets, which says nothing about fields.
fn is_never_true(filter: &Document) -> bool {
    filter.iter().any(|(name, value)| match (name.as_str(), value) {
        ("$and", Bson::Array(items)) => items.iter().filter_map(Bson::as_document).any(is_never_true),
        ("$or", Bson::Array(items)) => items.iter().all(|item| item.as_document().is_some_and(is_never_true)),
        (name, Bson::Document(operators)) if !name.starts_with('$') => {
            operators.iter().any(|(operator, value)| operator == "$all" && value.as_array().is_some_and(Vec::is_empty))
        }
        _ => false,
    })
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
                found.extend(equal_values(operators).into_iter().map(|value| (name.to_owned(), value.clone())));
            }
            (_, Bson::RegularExpression(_)) => {}
            (name, value) => found.push((name.to_owned(), value.clone())),
        }
    }
    Ok(())
}

/// Returns the values that a field equals by its operators.
fn equal_values(operators: &Document) -> Vec<&Bson> {
    let mut values = Vec::new();
    for (name, value) in operators {
        match (name.as_str(), value) {
            ("$eq", value) => values.push(value),
            ("$in", Bson::Array(items))
                if items.iter().all(|item| items.first().is_some_and(|first| equal(first, item))) =>
            {
                values.extend(items.iter().take(1).filter(|item| is_plain(item)))
            }
            ("$all", Bson::Array(items)) => values.extend(items.iter().filter(|item| is_plain(item))),
            _ => {}
        }
    }
    values
}

/// Returns whether a listed value is one to be equal to.
fn is_plain(value: &Bson) -> bool {
    match value {
        Bson::Document(inner) => !is_operators(inner.into()),
        Bson::RegularExpression(_) => false,
        _ => true,
    }
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
    QueryError::invalid(54, format!("cannot infer query fields to set, path '{path}' is matched twice")).about(path)
}
