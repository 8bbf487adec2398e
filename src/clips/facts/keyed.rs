//! Facts that replace documents by a key other than `_id`.

use std::collections::{HashMap, HashSet};

use bson::{Bson, Document, doc};

use super::key::RELATION;
use super::schema::INITIAL;
use crate::fault::{AtFault, Fault};
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::memory::Memory;
use crate::query::{QueryError, key as canonical};
use crate::store::{Find, Namespace, StoreError};

/// How many keys are looked up at once.
const BATCH: usize = 1_000;

/// Documents, each with the place of its fact.
pub type Found = Vec<(Span, Document)>;

/// Why documents cannot be matched to the stored ones by a key.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// A fact has no value for the key, several, or one that another fact has.
    #[error(transparent)]
    Text(#[from] Diagnostic),
    /// Two stored documents have the same value for the key.
    #[error("{namespace} has two documents with the `{key}` {value}; nothing was imported")]
    Ambiguous {
        /// The collection.
        namespace: Namespace,
        /// The key.
        key: String,
        /// Its value, as relaxed JSON.
        value: String,
    },
    /// The store fails.
    #[error("{0}")]
    Store(#[from] StoreError),
}

impl AtFault for KeyError {
    fn fault(&self) -> Fault {
        match self {
            Self::Text(_) | Self::Ambiguous { .. } => Fault::Input,
            Self::Store(error) => error.fault(),
        }
    }
}

/// Gives each document the `_id` of the stored document that has the same value under `key`.
/// Removes the initial fact, which CLIPS asserts by itself.
///
/// # Errors
/// Where a value is missing or not unique, or the store fails; see [`KeyError`].
pub fn give_ids(
    key: &str,
    source: &Source,
    documents: &mut Found,
    memory: &Memory,
    namespace: &Namespace,
) -> Result<(), KeyError> {
    let is_initial = |document: &Document| document.get_str(RELATION).is_ok_and(|name| name == INITIAL);
    documents.retain(|(_, document)| !is_initial(document));
    check_unique(key, source, documents)?;
    for batch in documents.chunks_mut(BATCH) {
        let values: Vec<Bson> = batch.iter().filter_map(|(_, document)| document.get(key).cloned()).collect();
        let stored = stored(key, values, memory, namespace)?;
        for (_, document) in batch {
            if let Some(id) = document.get(key).and_then(|value| stored.get(&canonical::encode_value(value))) {
                let rest = std::mem::take(document);
                *document = doc! { "_id": id.clone() }.into_iter().chain(rest).collect();
            }
        }
    }
    Ok(())
}

/// Checks that each document has one value under `key`, which no other document has.
fn check_unique(key: &str, source: &Source, documents: &Found) -> Result<(), Diagnostic> {
    let mut seen = HashMap::new();
    for (span, document) in documents {
        let value = match document.get(key) {
            None => return Err(Diagnostic::new(source, *span, format!("expected the slot `{key}`, the key"))),
            Some(Bson::Array(_)) => {
                return Err(Diagnostic::new(source, *span, format!("expected one value in the slot `{key}`, the key")));
            }
            Some(value) => value,
        };
        if let Some(first) = seen.insert(canonical::encode_value(value), *span) {
            let (line, column) = source.position(first.start);
            let message = format!("another fact has the key `{key}` {}", shell::relaxed_value(value));
            return Err(Diagnostic::new(source, *span, message).hint(format!("the other fact is at {line}:{column}")));
        }
    }
    Ok(())
}

/// The `_id`s of the stored documents with these values under `key`, by the values' canonical keys.
fn stored(
    key: &str,
    values: Vec<Bson>,
    memory: &Memory,
    namespace: &Namespace,
) -> Result<HashMap<Vec<u8>, Bson>, KeyError> {
    let find = Find { filter: doc! { key: { "$in": values } }, projection: doc! { key: 1 }, ..Find::default() };
    let (mut ids, mut twice) = (HashMap::new(), HashSet::new());
    for document in memory.find(namespace, &find)? {
        let mut document =
            Document::try_from(&*document?).map_err(|error| StoreError::from(QueryError::from(error)))?;
        let (Some(value), Some(id)) = (document.remove(key), document.remove("_id")) else { continue };
        let name = canonical::encode_value(&value);
        if ids.insert(name.clone(), id).is_some() && twice.insert(name) {
            let value = shell::relaxed_value(&value);
            return Err(KeyError::Ambiguous { namespace: namespace.clone(), key: key.to_owned(), value });
        }
    }
    Ok(ids)
}
