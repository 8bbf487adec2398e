//! Noting changes while documents are written.
//!
//! A change is noted in the transaction that makes it, and only where its collection is
//! watched: a memory without watchers pays nothing.

use std::rc::Rc;

use bson::Document;

use super::catalog::Collection;
use super::change_log::{self, LARGEST, Noted};
use super::place::Place;
use super::scan::Scan;
use super::{Embedded, notifier, watcher};
use crate::query::Filter;
use crate::store::{Namespace, StoreError};

impl Embedded {
    /// Appends a change where the collection is watched. Every write calls this, in its transaction.
    pub(super) fn note(&self, ns: &Namespace, noted: Noted<'_>) -> Result<(), StoreError> {
        if !self.is_watched(ns)? {
            return Ok(());
        }
        self.log.noted.set(true);
        change_log::append(&self.connection, ns, noted).map_err(|e| self.explain(&e))
    }

    /// Appends the changes of a rename: a drop of the old name, and for watchers of the new
    /// name a drop and an insert of each document.
    pub(super) fn note_rename(
        &self,
        collection: Collection,
        from: &Namespace,
        to: &Namespace,
    ) -> Result<(), StoreError> {
        self.note(from, Noted::drop())?;
        if !self.is_watched(to)? {
            return Ok(());
        }
        self.note(to, Noted::drop())?;
        for found in Scan::new(self, collection, &mut Rc::new(Filter::parse(&Document::new())?))? {
            self.note(to, Noted::insert(&found?.body))?;
        }
        Ok(())
    }

    /// Whether the collection is watched. In a write transaction only.
    pub(super) fn is_watched(&self, ns: &Namespace) -> Result<bool, StoreError> {
        if self.place == Place::Memory {
            return Ok(false);
        }
        let mut watched = self.log.watched.borrow_mut();
        if watched.is_none() {
            *watched = Some(watcher::watched(&self.connection).map_err(|e| self.explain(&e))?);
        }
        Ok(watched.as_ref().is_some_and(|watched| watched.iter().any(|kept| watcher::covers(kept, ns))))
    }

    /// To be called when the set of watches has changed within a write transaction.
    pub(super) fn look_again(&self) {
        self.log.watched.replace(None);
    }

    /// Resets the log. Called when a write transaction begins.
    pub(super) fn open_log(&self) {
        self.log.watched.replace(None);
        self.log.noted.set(false);
    }

    /// Bounds the size of the log. Called before a write transaction is committed.
    pub(super) fn bound_log(&self) -> Result<(), StoreError> {
        match self.log.noted.get() {
            true => change_log::bound(&self.connection, LARGEST).map_err(|e| self.explain(&e)),
            false => Ok(()),
        }
    }

    /// Notifies watchers. Called after a write transaction was committed.
    pub(super) fn publish_log(&self) {
        if let (true, Place::File(path)) = (self.log.noted.replace(false), &self.place) {
            notifier::notify(path);
        }
    }
}
