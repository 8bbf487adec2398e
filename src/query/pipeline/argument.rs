//! Arguments that several stages take: collections, paths, pipelines.

use bson::{Bson, Document};

use super::documents::Origin;
use crate::query::error::{QueryError, Result};
use crate::query::path::{Path, check_plain};

/// Reads the pipeline that a stage contains.
pub(super) fn inner(stage: &str, value: &Bson) -> Result<Vec<Document>> {
    let wrong = || QueryError::type_mismatch(format!("{stage} needs a pipeline: an array of objects"));
    let Bson::Array(items) = value else { return Err(wrong()) };
    items.iter().map(|item| item.as_document().cloned().ok_or_else(wrong)).collect()
}

/// Reads a string that may be absent.
pub(super) fn text<'a>(stage: &str, spec: &'a Document, name: &str) -> Result<Option<&'a str>> {
    match spec.get(name) {
        None => Ok(None),
        Some(Bson::String(text)) => Ok(Some(text)),
        Some(_) => Err(QueryError::failed_to_parse(format!("the argument '{name}' to {stage} must be a string"))),
    }
}

/// Reads a collection's name, perhaps with its database.
pub(super) fn origin(stage: &str, value: &Bson) -> Result<Origin> {
    let wrong = || QueryError::failed_to_parse(format!("{stage} 'from' must be a collection"));
    match value {
        Bson::String(name) if !name.is_empty() => Ok(Origin { database: None, collection: name.clone() }),
        Bson::Document(fields) => match (fields.get("db"), fields.get("coll")) {
            (Some(Bson::String(database)), Some(Bson::String(collection))) if fields.len() == 2 => {
                Ok(Origin { database: Some(database.clone()), collection: collection.clone() })
            }
            _ => Err(wrong()),
        },
        _ => Err(wrong()),
    }
}

/// Reads `as`, the path where results are put.
pub(super) fn target(stage: &str, spec: &Document) -> Result<Vec<String>> {
    let to = text(stage, spec, "as")?
        .ok_or_else(|| QueryError::failed_to_parse(format!("must specify 'as' field for a {stage}")))?;
    if to.is_empty() || to.split('.').any(|part| part.is_empty() || part.starts_with('$')) {
        return Err(QueryError::invalid(16_410, format!("'{to}' cannot be the 'as' of {stage}")));
    }
    Ok(to.split('.').map(str::to_owned).collect())
}

/// Reads a path without `$`.
pub(super) fn plain_path(text: &str) -> Result<Path> {
    check_plain(text)?;
    Path::parse(text)
}
