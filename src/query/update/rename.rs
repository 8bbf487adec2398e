//! Source and target of `$rename`, which may not lead through arrays.

use bson::{Bson, Document};

use super::modifier::Segment;
use super::outcome::PATH_NOT_VIABLE;
use crate::query::error::{QueryError, Result};
use crate::query::path::padded_index;

/// Returns the value that is moved; `None` if there is none, also in an array.
///
/// # Errors
/// If the path cannot lead on, or the value is in an array.
pub(super) fn source(document: &Document, path: &[Segment]) -> Result<Option<Bson>> {
    let mut names = path.iter().filter_map(name);
    let Some(mut value) = names.next().and_then(|first| document.get(first)) else { return Ok(None) };
    let mut in_array = false;
    for name in names {
        let next = match value {
            Bson::Document(inner) => inner.get(name),
            Bson::Array(items) => {
                in_array = true;
                let Some(index) = padded_index(name) else { return Err(dead_end(name, value)) };
                items.get(index)
            }
            _ => return Err(dead_end(name, value)),
        };
        match next {
            Some(next) => value = next,
            None => return Ok(None),
        }
    }
    match in_array {
        true => {
            Err(QueryError::bad_value("the source field of $rename cannot be an element of an array").about("$rename"))
        }
        false => Ok(Some(value.clone())),
    }
}

/// Refuses a target that leads through an array, and an `_id` that is there, whatever it is.
pub(super) fn check_target(document: &Document, path: &[Segment]) -> Result<()> {
    if path.first().and_then(name) == Some("_id") && document.contains_key("_id") {
        return Err(QueryError::invalid(66, "$rename would modify the immutable field '_id'").about("_id"));
    }
    let mut current = document;
    for name in path.iter().take(path.len().saturating_sub(1)).filter_map(name) {
        match current.get(name) {
            Some(Bson::Document(inner)) => current = inner,
            Some(Bson::Array(_)) => {
                let message = "the destination field of $rename cannot be an element of an array";
                return Err(QueryError::bad_value(message).about("$rename"));
            }
            _ => return Ok(()),
        }
    }
    Ok(())
}

fn name(segment: &Segment) -> Option<&str> {
    match segment {
        Segment::Name(name) => Some(name),
        _ => None,
    }
}

fn dead_end(name: &str, value: &Bson) -> QueryError {
    QueryError::invalid(PATH_NOT_VIABLE, format!("cannot use the part '{name}' to traverse the element {value}"))
}
