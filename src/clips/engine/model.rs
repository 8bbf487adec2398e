//! What one engine knows of the shared world model.

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, HashSet};

use bson::{Bson, Document};

use super::native::{Environment, FactRef};
use crate::clips::facts::record;
use crate::store::{Namespace, metadata};

/// The mark of a change, under `_robmem_info.clips`.
pub(super) const MARK: &str = "by";

/// A fact of the shared world.
pub(super) struct Known {
    pub(super) id: Bson,
    pub(super) sync_id: i64,
    pub(super) fact: Option<FactRef>,
    /// The mark of the engine's own change that has not come back yet.
    pub(super) pending: Option<String>,
}

/// The shared world model of one engine.
pub(super) struct WorldModel {
    pub(super) namespace: Namespace,
    pub(super) started: Cell<bool>,
    /// By what tells `_id`s apart.
    pub(super) known: RefCell<HashMap<Vec<u8>, Known>>,
    pub(super) keys: RefCell<HashMap<i64, Vec<u8>>>,
    /// Facts that were retracted here, of which older changes may still come.
    pub(super) gone: RefCell<HashSet<Vec<u8>>>,
    pub(super) engine: String,
    pub(super) changes: Cell<u64>,
    /// How many documents have come back from a resync.
    pub(super) resynced: Cell<u64>,
    pub(super) resync: RefCell<Option<String>>,
    /// Templates of documents that this engine does not know.
    pub(super) strange: RefCell<HashSet<String>>,
}

impl WorldModel {
    pub(super) fn new(namespace: Namespace) -> Self {
        Self {
            namespace,
            started: Cell::new(false),
            known: RefCell::default(),
            keys: RefCell::default(),
            gone: RefCell::default(),
            engine: crate::query::object_id::new().to_hex(),
            changes: Cell::new(0),
            resynced: Cell::new(0),
            resync: RefCell::default(),
            strange: RefCell::default(),
        }
    }

    /// A mark that no other change has.
    pub(super) fn mark(&self) -> String {
        self.changes.set(self.changes.get() + 1);
        format!("{}-{}", self.engine, self.changes.get())
    }

    /// Whether the document is from before the engine's own change of it.
    pub(super) fn is_older(&self, key: &[u8], document: &Document) -> bool {
        let mut known = self.known.borrow_mut();
        let Some(known) = known.get_mut(key) else { return false };
        if known.pending.is_some() && known.pending.as_deref() != mark_of(document) {
            return true;
        }
        known.pending = None;
        false
    }

    pub(super) fn keep(&self, key: &[u8], known: Known) {
        self.keys.borrow_mut().insert(known.sync_id, key.to_vec());
        self.known.borrow_mut().insert(key.to_vec(), known);
    }

    /// Retracts the fact of a document.
    pub(super) fn forget(&self, key: &[u8], clips: &Environment) {
        let known = self.known.borrow_mut().remove(key);
        let Some(known) = known else { return };
        self.keys.borrow_mut().remove(&known.sync_id);
        if let Some(fact) = known.fact {
            clips.retract(&fact);
        }
    }
}

pub(super) fn mark_path() -> String {
    format!("{}.{}.{MARK}", metadata::INFO, record::KEY)
}

pub(super) fn mark_of(document: &Document) -> Option<&str> {
    document.get_document(metadata::INFO).ok()?.get_document(record::KEY).ok()?.get_str(MARK).ok()
}

/// What tells documents apart by their `_id`.
pub(super) fn key(id: &Bson) -> Vec<u8> {
    crate::query::key::encode_value(id)
}
