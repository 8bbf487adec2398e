//! Triggers: the changes of a collection that match a query.
//!
//! The query is matched against the document after the change, before it for a
//! deletion; so a `$set` that makes a document match is a trigger, and one that makes
//! it match no more is none. Where the store does not know what was deleted, the
//! deletion is delivered. That the collection was dropped is always delivered. What
//! changes nothing but the dates of `_robmem_info` is no change; that a document decayed
//! is one when it is removed.

use std::time::{Duration, Instant};

use bson::{Document, RawDocumentBuf};

use super::{Memory, hidden_metadata};
use crate::query::{Filter, QueryError};
use crate::store::{Change, ChangeKind, Changes, Name, Namespace, Next, StoreError, metadata};

/// Which changes are wanted.
#[derive(Debug, Clone)]
pub struct Trigger {
    /// Of which collection.
    pub namespace: Namespace,
    /// Of which documents: MongoDB's filter.
    pub filter: Document,
    /// Under which name the position is kept, so that nothing is missed between two processes.
    pub name: Option<String>,
    /// Whether documents that computables made count.
    pub computed: bool,
    /// Whether documents are shown with their metadata.
    pub metadata: bool,
}

/// The changes that a trigger wants, as they are made.
pub struct Watch<'a> {
    trigger: Trigger,
    filter: Filter,
    changes: Box<dyn Changes + 'a>,
}

impl Memory {
    /// Begins to watch; see [`crate::store::Store::watch`].
    ///
    /// # Errors
    /// Where the filter is wrong, the store cannot be watched, or another process has the name.
    pub fn watch(&self, trigger: Trigger) -> Result<Watch<'_>, StoreError> {
        let filter = Filter::parse(&hidden_metadata::in_filter(&trigger.filter))?;
        let changes = self.store(&trigger.namespace)?.watch(&trigger.namespace, trigger.name.as_deref())?;
        Ok(Watch { trigger, filter, changes })
    }

    /// Whether a query sees everything that was written before it, by any client. The nearest member of a
    /// replica set may be behind; [`Memory::watch`] is exact on every store.
    ///
    /// # Errors
    /// Where the store cannot be opened.
    pub fn is_current(&self, ns: &Namespace) -> Result<bool, StoreError> {
        Ok(self.store(ns)?.is_atomic())
    }

    /// Removes the name of a watch; returns whether it existed.
    ///
    /// # Errors
    /// Where a process watches by it, or it belongs to another collection.
    pub fn forget_watch(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        self.store(ns)?.forget(ns, name)
    }
}

impl Memory {
    /// The names of watches in both stores.
    ///
    /// # Errors
    /// Where a store fails.
    pub fn watch_names(&self) -> Result<Vec<Name>, StoreError> {
        self.routes.names()
    }
}

impl Watch<'_> {
    /// The next change that is wanted, or nothing if none comes within `timeout`.
    ///
    /// # Errors
    /// Where nothing more will come; see [`Changes::next`].
    pub fn next(&mut self, timeout: Duration) -> Result<Next, StoreError> {
        let start = Instant::now();
        loop {
            let change = match self.changes.next(timeout.saturating_sub(start.elapsed()))? {
                Next::Change(change) => change,
                other => return Ok(other),
            };
            if self.wants(&change)? {
                return Ok(Next::Change(Box::new(self.shown(*change)?)));
            }
            if start.elapsed() >= timeout {
                return Ok(Next::Nothing);
            }
        }
    }

    /// Records that the application is done with all changes returned so far.
    ///
    /// # Errors
    /// See [`Changes::done`].
    pub fn done(&mut self) -> Result<(), StoreError> {
        self.changes.done()
    }

    /// Records that this process is running, while it is busy with a change.
    ///
    /// # Errors
    /// See [`Changes::renew`].
    pub fn renew(&mut self) -> Result<(), StoreError> {
        self.changes.renew()
    }

    fn wants(&self, change: &Change) -> Result<bool, QueryError> {
        let known = change.after.as_ref().or(change.before.as_ref());
        let (ChangeKind::Insert | ChangeKind::Update | ChangeKind::Replace | ChangeKind::Delete, Some(document)) =
            (change.kind, known)
        else {
            return Ok(true);
        };
        let hidden = !self.trigger.computed && metadata::is_computed(document)?;
        Ok(!hidden && self.filter.matches(document)?)
    }

    fn shown(&self, change: Change) -> Result<Change, QueryError> {
        if self.trigger.metadata {
            return Ok(change);
        }
        let hide = |document: Option<RawDocumentBuf>| document.map(metadata::hide).transpose();
        Ok(Change { before: hide(change.before)?, after: hide(change.after)?, ..change })
    }
}

/// A change as a document: `{operation, ns, _id, before, after, time, position}`, without
/// the keys that it has no value for.
///
/// # Errors
/// Where a document of the store is malformed.
pub fn event(ns: &Namespace, change: &Change) -> Result<Document, QueryError> {
    let mut event = Document::new();
    event.insert("operation", change.kind.name());
    event.insert("ns", ns.to_string());
    event.extend(change.id.clone().map(|id| ("_id".to_owned(), id)));
    for (key, document) in [("before", &change.before), ("after", &change.after)] {
        if let Some(document) = document {
            event.insert(key, Document::try_from(&**document)?);
        }
    }
    event.insert("time", change.time);
    event.insert("position", change.position.clone());
    Ok(event)
}
