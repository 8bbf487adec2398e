//! Storing what bodies gave, and removing it.

use std::collections::HashSet;

use bson::oid::ObjectId;
use bson::{Bson, DateTime, Document, doc};

use super::cache::Lifetime;
use super::definition::Definition;
use crate::fault::{AtFault, Fault};
use crate::formats::shell;
use crate::query::{QueryError, key};
use crate::store::{Namespace, Store, StoreError, metadata};

/// How many documents are stored at once.
pub(super) const BATCH: usize = 1_000;

/// What a body gave, with the metadata of a computation.
///
/// # Errors
/// Where two documents have one `_id`.
pub(super) fn marked(
    definition: &Definition,
    documents: Vec<Document>,
    token: ObjectId,
    life: Lifetime,
    now: DateTime,
) -> Result<Vec<Document>, StoreError> {
    if let Some(id) = doubled(&documents) {
        let wrong = format!("it gave two documents with _id {}", shell::relaxed_value(id));
        return Err(StoreError::computable(&definition.name, QueryError::bad_value(wrong)));
    }
    let info = doc! {
        metadata::INSERTED: now,
        "computed": true,
        "cached_until": life.until,
        metadata::DECAY: life.kept,
        metadata::COMPUTATION: { "by": &definition.name, "token": token },
    };
    let mark = |mut document: Document| {
        document.insert(metadata::INFO, info.clone());
        document
    };
    Ok(documents.into_iter().map(mark).collect())
}

/// Stores the documents of a computation, all or none; returns the `_id`s.
pub(super) fn insert(
    store: &dyn Store,
    definition: &Definition,
    documents: Vec<Document>,
    token: ObjectId,
) -> Result<Vec<Bson>, StoreError> {
    let mut ids = Vec::with_capacity(documents.len());
    let mut rest = documents.into_iter();
    loop {
        let batch: Vec<Document> = rest.by_ref().take(BATCH).collect();
        if batch.is_empty() {
            return Ok(ids);
        }
        match store.insert(&definition.namespace, batch) {
            Ok(inserted) => ids.extend(inserted.ids),
            Err(error) => {
                ids.extend(error.stored().iter().cloned());
                remove(store, &definition.namespace, &ids, token)?;
                return Err(unstorable(definition, error));
            }
        }
    }
}

/// Removes documents of one computation.
pub(super) fn remove(store: &dyn Store, ns: &Namespace, ids: &[Bson], token: ObjectId) -> Result<(), StoreError> {
    for ids in ids.chunks(BATCH) {
        store.delete(ns, (&doc! { "_id": { "$in": ids }, metadata::computation("token"): token }).into(), false)?;
    }
    Ok(())
}

/// An `_id` that two of the documents have.
fn doubled(documents: &[Document]) -> Option<&Bson> {
    let mut seen = HashSet::new();
    documents.iter().filter_map(|document| document.get("_id")).find(|id| !seen.insert(key::encode_value(id)))
}

/// What a body gave cannot be stored.
pub(super) fn unstorable(definition: &Definition, error: StoreError) -> StoreError {
    StoreError::computable(&definition.name, Unstorable { namespace: definition.namespace.clone(), source: error })
}

/// Computed documents could not be stored.
#[derive(Debug, thiserror::Error)]
#[error("what it gave cannot be stored in {namespace}: {source}{}", hint(source))]
struct Unstorable {
    namespace: Namespace,
    source: StoreError,
}

impl AtFault for Unstorable {
    fn fault(&self) -> Fault {
        self.source.fault()
    }
}

fn hint(error: &StoreError) -> &'static str {
    match error {
        StoreError::Duplicate { key, .. } if key.index().is_some() => {
            "; that document is stored or computed, too: unique indexes of the collection hold for computed documents, so \
             give each of them values of its own there"
        }
        StoreError::Duplicate { .. } => "; computed documents take no other one's place: leave the _id out",
        _ => "",
    }
}
