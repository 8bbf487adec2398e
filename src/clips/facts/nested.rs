//! What becomes of values that no slot can hold.

use bson::{Bson, Document};

use super::error::FactError;
use crate::formats::shell;
use crate::store::metadata;

/// What becomes of values that no slot can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Nested {
    /// They are errors.
    #[default]
    Refuse,
    /// The keys of nested documents become slots, joined with `_`; arrays in arrays become one.
    Flatten,
    /// They are written as JSON, in a string.
    Json,
}

/// The document without nesting.
pub(super) fn flatten(document: &Document) -> Result<Document, FactError> {
    let mut flat = Document::new();
    for (key, value) in document {
        if key == metadata::INFO || key == "_id" {
            flat.insert(key.clone(), value.clone());
        } else {
            place(key.clone(), value, &mut flat)?;
        }
    }
    Ok(flat)
}

/// As deep as documents can be nested.
fn place(key: String, value: &Bson, flat: &mut Document) -> Result<(), FactError> {
    match value {
        Bson::Document(inner) if inner.is_empty() => {
            Err(FactError::new(&key, "is an empty document, of which no slot would be left"))
        }
        Bson::Document(inner) => inner.iter().try_for_each(|(name, value)| place(format!("{key}_{name}"), value, flat)),
        _ if flat.contains_key(&key) => Err(FactError::new(&key, "comes twice when nested keys are joined with `_`")),
        Bson::Array(values) => {
            let mut elements = Vec::new();
            splice(values, &mut elements);
            flat.insert(key, elements);
            Ok(())
        }
        other => {
            flat.insert(key, other.clone());
            Ok(())
        }
    }
}

fn splice(values: &[Bson], into: &mut Vec<Bson>) {
    for value in values {
        match value {
            Bson::Array(inner) => splice(inner, into),
            other => into.push(other.clone()),
        }
    }
}

/// The value as JSON.
pub(super) fn json(value: &Bson) -> String {
    shell::relaxed_value(value)
}
