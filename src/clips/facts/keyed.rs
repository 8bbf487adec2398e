//! Facts that replace documents by keys other than `_id`.

use std::collections::{BTreeSet, HashMap};

use bson::{Bson, Document, doc};

use super::key::RELATION;
use super::schema::INITIAL;
use crate::fault::{AtFault, Fault};
use crate::formats::{Diagnostic, Respelled, Span, Texts, alike, nearest, shell};
use crate::memory::Memory;
use crate::query::{QueryError, key as canonical};
use crate::store::{Find, Namespace, StoreError};

/// How many keys are looked up at once.
const BATCH: usize = 1_000;

/// Documents, each with the place of its fact among the texts.
pub type Found = Vec<(Span, Document)>;

/// Why documents cannot be matched to the stored ones by a key.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// A fact has no value for the key, several, or one that another fact or several stored documents have.
    #[error(transparent)]
    Text(#[from] Diagnostic),
    /// The store fails.
    #[error("{0}")]
    Store(#[from] StoreError),
}

impl AtFault for KeyError {
    fn fault(&self) -> Fault {
        match self {
            Self::Text(_) => Fault::Input,
            Self::Store(error) => error.fault(),
        }
    }
}

/// Returns the keys as the documents spell them: one that no document has is taken for one that differs from it only in
/// hyphens and underscores.
#[must_use]
pub fn spelled(keys: &[String], documents: &Found, respelled: &Respelled) -> Vec<String> {
    let names = || documents.iter().flat_map(|(_, document)| document.keys().map(String::as_str));
    let spelled = |key: &String| {
        let found = alike(key, names()).unwrap_or(key);
        if found != key {
            respelled.add(key, found);
        }
        found.to_owned()
    };
    keys.iter().map(spelled).collect()
}

/// Gives each document the `_id` of the stored document that has the same values under all `keys`,
/// whose stored spelling may differ in hyphens and underscores.
/// Removes the initial fact, which CLIPS asserts by itself.
///
/// # Errors
/// Where a value is missing or not unique, or the store fails; see [`KeyError`].
pub fn give_ids(
    keys: &[String],
    texts: &Texts,
    documents: &mut Found,
    memory: &Memory,
    namespace: &Namespace,
    respelled: &Respelled,
) -> Result<(), KeyError> {
    let is_initial = |document: &Document| document.get_str(RELATION).is_ok_and(|name| name == INITIAL);
    documents.retain(|(_, document)| !is_initial(document));
    check_unique(keys, texts, documents)?;
    for batch in documents.chunks_mut(BATCH) {
        let stored = stored(keys, texts, batch, memory, namespace, respelled)?;
        for (_, document) in batch {
            if let Some(id) =
                identity(keys, document).and_then(|identity| stored.get(&canonical::encode_value(&identity)))
            {
                let rest = std::mem::take(document);
                *document = doc! { "_id": id.clone() }.into_iter().chain(rest).collect();
            }
        }
    }
    Ok(())
}

/// The values that tell a document from others: one, or of several keys an array. None where one is missing.
fn identity(keys: &[String], document: &Document) -> Option<Bson> {
    match keys {
        [key] => document.get(key).cloned(),
        keys => keys.iter().map(|key| document.get(key).cloned()).collect::<Option<Vec<_>>>().map(Bson::Array),
    }
}

/// Keys and values as messages have them: `` `name` "R1", `team` "CYAN" ``.
fn named(keys: &[String], document: &Document) -> String {
    let value = |key: &String| document.get(key).map(shell::relaxed_value).unwrap_or_default();
    keys.iter().map(|key| format!("`{key}` {}", value(key))).collect::<Vec<_>>().join(", ")
}

/// Checks that each document has one value under each key, and that no other document has all of them.
fn check_unique(keys: &[String], texts: &Texts, documents: &Found) -> Result<(), Diagnostic> {
    let mut seen = HashMap::new();
    for (span, document) in documents {
        for key in keys {
            let number = match document.get(key) {
                None => "the slot",
                Some(Bson::Array(_)) => "one value in the slot",
                Some(_) => continue,
            };
            let error = texts.complain(*span, format!("expected {number} `{key}`, the key"));
            if document.contains_key(key) {
                return Err(error);
            }
            let meant = nearest(key, document.keys().map(String::as_str).filter(|name| *name != RELATION));
            return Err(error.hint(meant.map_or_else(
                || "import facts that have no such slot from a file of their own, without --key".to_owned(),
                |name| format!("did you mean `{name}`?"),
            )));
        }
        let Some(identity) = identity(keys, document) else { continue };
        if let Some(first) = seen.insert(canonical::encode_value(&identity), *span) {
            let place = texts.place_beside(first.start, span.start);
            let message = format!("another fact has the key {}", named(keys, document));
            return Err(texts.complain(*span, message).hint(format!("the other fact is at {place}")));
        }
    }
    Ok(())
}

/// The `_id`s of the stored documents with the values of these under the keys, by the values' canonical keys. A stored key may
/// differ in hyphens and underscores; a document with the exact keys goes first.
fn stored(
    keys: &[String],
    texts: &Texts,
    documents: &[(Span, Document)],
    memory: &Memory,
    namespace: &Namespace,
    respelled: &Respelled,
) -> Result<HashMap<Vec<u8>, Bson>, KeyError> {
    let (mut conditions, mut projection) = (Vec::new(), Document::new());
    for key in keys {
        let values: Vec<Bson> = documents.iter().filter_map(|(_, document)| document.get(key).cloned()).collect();
        let spellings: BTreeSet<String> = [key.clone(), key.replace('_', "-"), key.replace('-', "_")].into();
        projection.extend(spellings.iter().map(|spelling| (spelling.clone(), Bson::Int32(1))));
        let any = spellings.into_iter().map(|spelling| doc! { spelling: { "$in": values.clone() } });
        conditions.push(doc! { "$or": any.collect::<Vec<_>>() });
    }
    let wanted: HashMap<Vec<u8>, Span> = documents
        .iter()
        .filter_map(|(span, document)| Some((canonical::encode_value(&identity(keys, document)?), *span)))
        .collect();
    let find = Find { filter: doc! { "$and": conditions }, projection, ..Find::default() };
    // Each with whether the keys are spelled as they are there.
    let mut ids: HashMap<Vec<u8>, (Bson, bool)> = HashMap::new();
    for document in memory.find(namespace, &find)? {
        let mut document =
            Document::try_from(&*document?).map_err(|error| StoreError::from(QueryError::from(error)))?;
        let spelled: Vec<String> =
            keys.iter().map(|key| alike(key, document.keys().map(String::as_str)).unwrap_or(key).to_owned()).collect();
        let is_exact = spelled == keys;
        let (Some(identity), Some(id)) = (identity(&spelled, &document), document.remove("_id")) else { continue };
        let name = canonical::encode_value(&identity);
        let Some(span) = wanted.get(&name) else { continue };
        match ids.get(&name) {
            Some((_, known)) if *known == is_exact => {
                let key = named(&spelled, &document);
                let message = format!("{namespace} has two documents with the {key}; nothing was imported");
                let hint = "name one more slot that tells them apart, like --key SLOT,SLOT, or delete one of them";
                return Err(texts.complain(*span, message).hint(hint).into());
            }
            Some((_, true)) => continue,
            _ => drop(ids.insert(name, (id, is_exact))),
        }
        keys.iter()
            .zip(&spelled)
            .filter(|(key, found)| key != found)
            .for_each(|(key, found)| respelled.add(key, found));
    }
    Ok(ids.into_iter().map(|(name, (id, _))| (name, id)).collect())
}
