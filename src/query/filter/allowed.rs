//! Where a filter may have `$expr`.

use bson::{Bson, Document};

use crate::query::error::{QueryError, Result};

/// Refuses a filter that no upsert may have: `$expr` says nothing about fields, and MongoDB refuses it wherever it stands.
///
/// # Errors
/// Where the filter has one (code 224).
pub fn check_upsert(filter: &Document) -> Result<()> {
    match has_expression(filter) {
        true => Err(not_allowed("$expr is not allowed in the query predicate for an upsert")),
        false => Ok(()),
    }
}

/// Whether a projection shows the element of an array that the query matched.
#[must_use]
pub fn is_positional(projection: &Document) -> bool {
    projection.keys().any(|path| path.ends_with(".$"))
}

/// Refuses a filter with `$expr` beside the positional `$` of a projection, as MongoDB does.
///
/// # Errors
/// Where the filter has one and the projection the other (code 224).
pub fn check_positional(filter: &Document, projection: &Document) -> Result<()> {
    match is_positional(projection) && has_expression(filter) {
        true => Err(not_allowed("$expr does not go with the positional `$` of a projection")),
        false => Ok(()),
    }
}

fn not_allowed(message: &str) -> QueryError {
    QueryError::invalid(224, message).about("$expr")
}

fn has_expression(filter: &Document) -> bool {
    filter.iter().any(|(name, value)| match (name.as_str(), value) {
        ("$expr", _) => true,
        ("$and" | "$or" | "$nor", Bson::Array(items)) => items.iter().filter_map(Bson::as_document).any(has_expression),
        _ => false,
    })
}
