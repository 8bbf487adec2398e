//! The history of a collection: what changed, by which command or program, and when.
//!
//! It is kept where `keep_history` says so, in the transaction that makes the change
//! ([`crate::store::history`]). Documents of computables are not part of it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bson::{Bson, DateTime, Document};

use super::watch::event;
use super::{Memory, hidden_metadata};
use crate::query::collation::during;
use crate::query::{Collation, Filter, QueryError};
use crate::store::history::{Entry, HistoryRule, not_kept};
use crate::store::{Change, ChangeKind, Namespace, StoreError, metadata};

/// Which changes of a history are wanted.
#[derive(Debug, Clone)]
pub struct Selection {
    /// Of which collection.
    pub namespace: Namespace,
    /// Of which documents: MongoDB's filter, matched against the document after the change, else before it.
    pub filter: Document,
    /// Made after this time.
    pub since: Option<DateTime>,
    /// Made by a command or program whose name contains this.
    pub by: Option<String>,
    /// With these positions; all, where there are none.
    pub positions: Vec<String>,
}

/// How it is with the history of a collection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HistoryState {
    /// None is kept.
    None,
    /// The settings keep it, from the next write on.
    Coming,
    /// It is kept.
    Kept,
    /// It was kept, and goes with the next write: the settings switch it off.
    Ending,
}

impl Memory {
    /// The same memory, which keeps the histories of these rules and signs changes with a name.
    #[must_use]
    pub fn with_history(self, rules: &[HistoryRule], author: &str) -> Self {
        self.routes.keep_history(rules, author);
        self
    }

    /// Sets the author of the changes that follow, as one run.
    pub fn sign(&self, author: &str) {
        self.routes.sign(author);
    }

    /// Records what all clients of a server change, until a time is over or `interrupted`; see
    /// [`crate::store::Store::record`].
    ///
    /// # Errors
    /// Where no history is kept, the store records itself, or it fails.
    pub fn record(
        &self,
        ns: &Namespace,
        timeout: Option<Duration>,
        interrupted: &AtomicBool,
        begun: &mut dyn FnMut(),
    ) -> Result<u64, StoreError> {
        let (stop, over) = (AtomicBool::new(false), AtomicBool::new(false));
        let deadline = timeout.and_then(|timeout| Instant::now().checked_add(timeout));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let is_due = || deadline.is_some_and(|deadline| Instant::now() >= deadline);
                while !over.load(Ordering::Relaxed) && !interrupted.load(Ordering::Relaxed) && !is_due() {
                    std::thread::sleep(Duration::from_millis(20));
                }
                stop.store(true, Ordering::Relaxed);
            });
            let recorded = self.routes.of(ns).and_then(|store| store.record(ns, &stop, begun));
            over.store(true, Ordering::Relaxed);
            recorded
        })
    }

    /// How it is with the history of a collection.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn history_state(&self, ns: &Namespace) -> Result<HistoryState, StoreError> {
        let is_kept = self.routes.reading(ns)?.history(ns, Some(DateTime::now()))?.is_some();
        let rules = self.routes.histories(ns);
        Ok(match is_kept {
            true if HistoryRule::is_off(&rules, ns) => HistoryState::Ending,
            true => HistoryState::Kept,
            false if HistoryRule::of(&rules, ns).is_some() => HistoryState::Coming,
            false => HistoryState::None,
        })
    }

    /// The kept changes that a selection wants, in order.
    ///
    /// # Errors
    /// Where the filter is wrong, no history is or will be kept, or the store fails.
    pub fn history(
        &self,
        selection: &Selection,
    ) -> Result<impl Iterator<Item = Result<Entry, StoreError>> + '_, StoreError> {
        let ns = &selection.namespace;
        let collation = self.collation(ns)?;
        let filter = during(collation.as_ref(), || Filter::parse(&hidden_metadata::in_filter(&selection.filter)))?;
        let history = self.routes.reading(ns)?.history(ns, selection.since)?;
        let rules = self.routes.histories(ns);
        let entries = match history {
            Some(history) => history.entries,
            // It begins with the next change.
            None if HistoryRule::of(&rules, ns).is_some() => Box::new(std::iter::empty()),
            None => return Err(not_kept(ns, &rules)),
        };
        let wanted = Wanted { filter, selection: selection.clone(), collation };
        Ok(entries.filter_map(move |entry| match entry {
            Ok(entry) => match wanted.wants(&entry) {
                Ok(true) => Some(Ok(entry)),
                Ok(false) => None,
                Err(error) => Some(Err(error.into())),
            },
            Err(error) => Some(Err(error)),
        }))
    }
}

struct Wanted {
    filter: Filter,
    /// How strings compare in the collection now.
    collation: Option<Collation>,
    selection: Selection,
}

impl Wanted {
    fn wants(&self, entry: &Entry) -> Result<bool, QueryError> {
        let Selection { by, positions, filter, .. } = &self.selection;
        let by_wanted = by.as_ref().is_none_or(|by| entry.author.as_ref().is_some_and(|author| author.contains(by)));
        if !by_wanted || !positions.is_empty() && !positions.contains(&entry.change.position) {
            return Ok(false);
        }
        match entry.change.after.as_ref().or(entry.change.before.as_ref()) {
            Some(document) => during(self.collation.as_ref(), || self.filter.matches(document)),
            None => Ok(filter.is_empty() || entry.change.kind == ChangeKind::Delete),
        }
    }
}

/// An entry as a document: `{time, by, operation, ns, _id, before, after, position}`, without the keys
/// that it has no value for.
///
/// # Errors
/// Where a document of the store is malformed.
pub fn listed(ns: &Namespace, entry: &Entry, with_metadata: bool) -> Result<Document, QueryError> {
    let mut change = entry.change.clone();
    if !with_metadata {
        let hide = |document: Option<_>| document.map(metadata::hide).transpose();
        change = Change { before: hide(change.before)?, after: hide(change.after)?, ..change };
    }
    let mut event = event(ns, &change)?;
    let mut listed = Document::new();
    listed.extend(event.remove("time").map(|time| ("time".to_owned(), time)));
    listed.extend(entry.author.clone().map(|author| ("by".to_owned(), Bson::String(author))));
    listed.extend(event);
    Ok(listed)
}
