//! Facts that are there already: CLIPS keeps one of those that are equal.

use std::collections::{BTreeSet, HashSet};

use bson::{Bson, Document, doc};

use super::key::RELATION;
use super::keyed::Found;
use super::record;
use crate::memory::Memory;
use crate::query::QueryError;
use crate::store::{Find, Namespace, StoreError, metadata};

/// Leaves one of each group of equal facts; returns how many were removed.
pub fn remove_repeated(documents: &mut Found) -> usize {
    let (before, mut seen) = (documents.len(), HashSet::new());
    documents.retain(|(_, document)| seen.insert(content(document)));
    before - documents.len()
}

/// Removes the documents of facts that the collection has, whatever their `_id`s are; returns how many.
///
/// # Errors
/// Those of the store.
pub fn remove_stored(documents: &mut Found, memory: &Memory, namespace: &Namespace) -> Result<usize, StoreError> {
    let relations: BTreeSet<&str> =
        documents.iter().filter_map(|(_, document)| document.get_str(RELATION).ok()).collect();
    let relations: Vec<&str> = relations.into_iter().collect();
    let find = Find { filter: doc! { RELATION: { "$in": relations } }, ..Find::default() };
    let mut stored = HashSet::new();
    for document in memory.stored(namespace, &find)? {
        let document = Document::try_from(&*document?).map_err(QueryError::from)?;
        stored.insert(content(&document));
    }
    let before = documents.len();
    documents.retain(|(_, document)| !stored.contains(&content(document)));
    Ok(before - documents.len())
}

/// About as many bytes as most facts have.
const USUAL_SIZE: usize = 256;

/// What a fact says: its slots in any order, with their types, and no metadata of the memory.
fn content(document: &Document) -> Vec<u8> {
    let mut slots: Vec<(&String, &Bson)> = Vec::with_capacity(document.len());
    slots.extend(document.iter().filter(|(key, _)| !matches!(key.as_str(), "_id" | metadata::INFO)));
    slots.sort_unstable_by_key(|(key, _)| *key);
    let mut bytes = Vec::with_capacity(USUAL_SIZE);
    for (key, value) in slots {
        text(key, &mut bytes);
        encode(value, &mut bytes);
    }
    let types = document.get_document(metadata::INFO).and_then(|info| info.get_document(record::KEY)).ok();
    for list in ["strings", "instances"] {
        let labels = types.and_then(|types| types.get_array(list).ok()).into_iter().flatten();
        labels.for_each(|label| encode(label, &mut bytes));
        bytes.push(0);
    }
    bytes
}

/// Appends a value so that no other one has the same bytes, but for integers of other widths.
fn encode(value: &Bson, bytes: &mut Vec<u8>) {
    bytes.push(match value {
        Bson::Int32(_) => Bson::Int64(0).element_type() as u8,
        other => other.element_type() as u8,
    });
    match value {
        Bson::String(content) => text(content, bytes),
        Bson::Int32(number) => bytes.extend(i64::from(*number).to_le_bytes()),
        Bson::Int64(number) => bytes.extend(number.to_le_bytes()),
        Bson::Double(number) => bytes.extend(number.to_le_bytes()),
        Bson::Boolean(flag) => bytes.push(u8::from(*flag)),
        Bson::Array(values) => {
            bytes.extend(values.len().to_le_bytes());
            values.iter().for_each(|value| encode(value, bytes));
        }
        // No fact has such values.
        other => text(&other.to_string(), bytes),
    }
}

fn text(content: &str, bytes: &mut Vec<u8>) {
    bytes.extend(content.len().to_le_bytes());
    bytes.extend(content.as_bytes());
}
