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
    /// Notes a change where somebody watches the collection. Every write path
    /// calls this, in its transaction.
    pub(super) fn note(&self, ns: &Namespace, noted: Noted<'_>) -> Result<(), StoreError> {
        if !self.is_watched(ns)? {
            return Ok(());
        }
        self.log.noted.set(true);
        change_log::append(&self.connection, ns, noted).map_err(|e| self.explain(&e))
    }

    /// Notes that a collection takes the place of another: its old name is empty then,
    /// and those who watch the new one are given its documents.
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

    /// Whether somebody watches the collection. In a write transaction only.
    pub(super) fn is_watched(&self, ns: &Namespace) -> Result<bool, StoreError> {
        if self.place == Place::Memory {
            return Ok(false);
        }
        let mut watched = self.log.watched.borrow_mut();
        if watched.is_none() {
            *watched = Some(watcher::watched(&self.connection).map_err(|e| self.explain(&e))?);
        }
        Ok(watched.as_ref().is_some_and(|watched| watched.contains(ns)))
    }

    /// To be called when a write transaction begins.
    pub(super) fn open_log(&self) {
        self.log.watched.replace(None);
        self.log.noted.set(false);
    }

    /// To be called before a write transaction is committed.
    pub(super) fn bound_log(&self) -> Result<(), StoreError> {
        match self.log.noted.get() {
            true => change_log::bound(&self.connection, LARGEST).map_err(|e| self.explain(&e)),
            false => Ok(()),
        }
    }

    /// To be called after a write transaction was committed.
    pub(super) fn publish_log(&self) {
        if let (true, Place::File(path)) = (self.log.noted.replace(false), &self.place) {
            notifier::call(path);
        }
    }
}
