//! Which objects operations were reported of: what is gone can be said only of what was there.
//!
//! With the name of a watch, they are kept in the collection `rmem.scenes` of the objects' database, a document
//! `{_id: {watch, ns, id}, name}` for each and one `{_id: {watch}}`, so that a later watch knows them. An object is kept
//! before it is reported, with `unsure: true` until that is done, and until after its removal is: what a reader knows is never
//! missing.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use bson::{Document, RawDocument, doc};

use crate::memory::Memory;
use crate::query::QueryError;
use crate::store::{Find, Namespace, StoreError};

/// The collection.
const COLLECTION: &str = "rmem.scenes";

/// Where the document of an object is: its collection, and its `_id` as canonical text.
pub(super) type Key = (Namespace, String);

/// The objects that were reported and are not removed, each with its name.
pub(super) struct Reported<'a> {
    memory: &'a Memory,
    /// Where they are kept, under which name.
    kept: Option<(Namespace, String)>,
    names: BTreeMap<Key, String>,
    keys: HashMap<String, Key>,
    /// Those that changed since they were stored.
    changed: BTreeSet<Key>,
    /// Those that may not have been reported: a watch was killed meanwhile.
    unsure: BTreeSet<Key>,
    /// Whether a watch of this name reported before.
    is_known: bool,
}

impl<'a> Reported<'a> {
    /// Those that were kept under the name of a watch of this collection; none without a name.
    ///
    /// # Errors
    /// Where a store fails.
    pub(super) fn load(memory: &'a Memory, objects: &Namespace, watch: Option<&str>) -> Result<Self, StoreError> {
        let kept = watch.map(|watch| (beside(objects), watch.to_owned()));
        let mut reported = Self {
            memory,
            kept,
            names: BTreeMap::new(),
            keys: HashMap::new(),
            changed: BTreeSet::new(),
            unsure: BTreeSet::new(),
            is_known: false,
        };
        if let Some((namespace, watch)) = &reported.kept {
            let filter = doc! { "_id.watch": watch };
            for raw in memory.stored(namespace, &Find { filter, ..Find::default() })? {
                reported.is_known = true;
                let raw = raw?;
                if let Some((key, name)) = read(&raw)? {
                    if raw.get("unsure").map_err(QueryError::from)?.is_some() {
                        reported.unsure.insert(key.clone());
                    }
                    reported.keys.insert(name.clone(), key.clone());
                    reported.names.insert(key, name);
                }
            }
        }
        Ok(reported)
    }

    /// Whether a watch of this name reported before.
    pub(super) fn is_known(&self) -> bool {
        self.is_known
    }

    pub(super) fn contains(&self, key: &Key) -> bool {
        self.names.contains_key(key)
    }

    /// Whether it is one of them, and was reported for sure.
    pub(super) fn is_sure(&self, key: &Key) -> bool {
        self.contains(key) && !self.unsure.contains(key)
    }

    /// The document of the object with this name.
    pub(super) fn key(&self, name: &str) -> Option<&Key> {
        self.keys.get(name)
    }

    /// All of them, or those of a collection.
    pub(super) fn of(&self, namespace: Option<&Namespace>) -> Vec<Key> {
        self.names.keys().filter(|(of, _)| namespace.is_none_or(|namespace| of == namespace)).cloned().collect()
    }

    pub(super) fn add(&mut self, key: Key, name: &str) {
        self.remove(&key);
        self.keys.insert(name.to_owned(), key.clone());
        self.names.insert(key.clone(), name.to_owned());
        self.unsure.remove(&key);
        self.changed.insert(key);
    }

    /// Removes an object; gives its name.
    pub(super) fn remove(&mut self, key: &Key) -> Option<String> {
        let name = self.names.remove(key)?;
        self.keys.remove(&name);
        self.changed.insert(key.clone());
        Some(name)
    }

    /// Stores which objects are about to be reported.
    ///
    /// # Errors
    /// Where a store fails.
    pub(super) fn announce(&self) -> Result<(), StoreError> {
        let Some((namespace, watch)) = &self.kept else { return Ok(()) };
        let new = self.changed.iter().filter_map(|key| self.names.get(key).map(|name| (key, name)));
        let new: Vec<Document> =
            new.map(|(key, name)| doc! { "_id": id(watch, key), "name": name, "unsure": true }).collect();
        if !new.is_empty() {
            self.memory.put(namespace, new)?;
        }
        Ok(())
    }

    /// Stores what was reported.
    ///
    /// # Errors
    /// Where a store fails.
    pub(super) fn save(&mut self) -> Result<(), StoreError> {
        let changed = std::mem::take(&mut self.changed);
        let Some((namespace, watch)) = &self.kept else { return Ok(()) };
        let (there, gone): (Vec<_>, Vec<_>) = changed.iter().partition(|key| self.names.contains_key(*key));
        let mut documents: Vec<Document> =
            there.iter().map(|key| doc! { "_id": id(watch, key), "name": self.names.get(*key) }).collect();
        if !std::mem::replace(&mut self.is_known, true) {
            documents.push(doc! { "_id": { "watch": watch } });
        }
        if !documents.is_empty() {
            self.memory.put(namespace, documents)?;
        }
        for key in gone {
            self.memory.delete(namespace, &doc! { "_id": id(watch, key) }, true)?;
        }
        Ok(())
    }
}

fn id(watch: &str, (namespace, id): &Key) -> Document {
    doc! { "watch": watch, "ns": namespace.to_string(), "id": id }
}

/// Forgets which objects a watch of a collection reported; returns whether it reported some.
///
/// # Errors
/// Where a store fails.
pub fn forget(memory: &Memory, objects: &Namespace, watch: &str) -> Result<bool, StoreError> {
    Ok(memory.delete(&beside(objects), &doc! { "_id.watch": watch }, false)? > 0)
}

fn beside(objects: &Namespace) -> Namespace {
    Namespace { database: objects.database.clone(), collection: COLLECTION.to_owned() }
}

fn read(raw: &RawDocument) -> Result<Option<(Key, String)>, QueryError> {
    let document = Document::try_from(raw)?;
    let id = document.get_document("_id");
    let text = |key: &str| id.as_ref().ok().and_then(|id| id.get_str(key).ok());
    let (Some(ns), Some(id), Ok(name)) = (text("ns"), text("id"), document.get_str("name")) else { return Ok(None) };
    Ok(Namespace::parse(ns).ok().map(|ns| ((ns, id.to_owned()), name.to_owned())))
}
