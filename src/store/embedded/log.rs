//! Noting changes while documents are written.
//!
//! A change is noted in the transaction that makes it, and only where its collection is
//! watched or its history kept: a memory with neither pays nothing.

use std::sync::Arc;

use bson::{DateTime, Document, RawDocument, RawDocumentBuf};
use rusqlite::{Connection, OptionalExtension as _, params};

use super::catalog::Collection;
use super::change_log::{self, LARGEST, Noted};
use super::place::Place;
use super::scan::Scan;
use super::transaction::Watched;
use super::{Embedded, history, notifier, watcher};
use crate::query::{Filter, QueryError};
use crate::store::{Modifiers, Namespace, NotedChanges, StoreError};

/// The watchers of a collection.
#[derive(Clone, Copy)]
struct Wanted {
    by_watches: bool,
    by_streams: bool,
    /// The size of the history that keeps them.
    by_history: Option<i64>,
}

impl Embedded {
    /// Appends a change where the collection is watched or its history kept. Every write calls this, in its
    /// transaction.
    pub(super) fn note(&self, ns: &Namespace, noted: Noted<'_>) -> Result<(), StoreError> {
        let wanted = self.wanted(ns)?;
        let known = noted.after.or(noted.before);
        let is_kept = wanted.by_history.is_some() && !history::is_computed(known);
        let is_for_watches = wanted.by_watches && !noted.is_of_history_alone();
        let is_for_streams = wanted.by_streams && noted.is_for_streams();
        if !is_kept && !is_for_watches && !is_for_streams {
            return Ok(());
        }
        let append = || {
            self.append(ns, noted)?;
            if is_kept { history::sign(&self.connection, &self.log.keeping, noted.place) } else { Ok(()) }
        };
        append().map_err(|e| self.explain(&e))
    }

    fn append(&self, ns: &Namespace, noted: Noted<'_>) -> rusqlite::Result<()> {
        change_log::append(&self.connection, ns, noted)?;
        self.log.last.set(self.connection.last_insert_rowid());
        if !self.log.noted.replace(true) {
            self.log.first.set(self.log.last.get());
        }
        Ok(())
    }

    /// The changes of the last write transaction that made some and was committed, where the last of them is still kept.
    pub(super) fn committed(&self) -> Result<Option<NotedChanges>, StoreError> {
        let Some((first, last)) = self.log.committed.get() else { return Ok(None) };
        let time = self
            .connection
            .prepare_cached("SELECT time FROM changes WHERE sequence = ?")
            .and_then(|mut statement| statement.query_row([last], |row| row.get(0)).optional());
        let time = time.map_err(|e| self.explain(&e))?;
        Ok(time.map(|time| NotedChanges { first, last, time: DateTime::from_millis(time) }))
    }

    /// The changes of the write transaction.
    pub(super) fn noted(&self) -> Result<Option<NotedChanges>, StoreError> {
        if !self.log.noted.get() {
            return Ok(None);
        }
        let first = self.log.first.get();
        let sql = "SELECT sequence, time FROM changes WHERE sequence >= ? ORDER BY sequence DESC LIMIT 1";
        let last = self.connection.prepare_cached(sql).and_then(|mut statement| {
            let read = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, DateTime::from_millis(row.get(1)?)));
            statement.query_row([first], read).optional()
        });
        Ok(last.map_err(|e| self.explain(&e))?.map(|(last, time)| NotedChanges { first, last, time }))
    }

    /// The same, all of them at a time.
    pub(super) fn joined(&self, time: DateTime) -> Result<Option<NotedChanges>, StoreError> {
        let Some(noted) = self.noted()? else { return Ok(None) };
        let sql = "UPDATE changes SET time = ? WHERE sequence >= ?";
        let joined = self.connection.prepare_cached(sql);
        let joined = joined.and_then(|mut all| all.execute(params![time.timestamp_millis(), noted.first]));
        joined.map_err(|e| self.explain(&e))?;
        Ok(Some(NotedChanges { time, ..noted }))
    }

    /// Appends the changes of a drop, before it is done: for the history, the documents that go. `names` are those of the
    /// rename that drops the collection, where change streams are told of one.
    pub(super) fn note_drop(
        &self,
        ns: &Namespace,
        collection: Collection,
        names: Option<&RawDocument>,
    ) -> Result<(), StoreError> {
        let drop = Noted::drop(None).by_rename(names);
        let Some(most) = self.wanted(ns)?.by_history else { return self.note(ns, drop) };
        if collection.bytes(&self.connection).map_err(|e| self.explain(&e))? > most {
            return self.note(ns, drop.of_history());
        }
        for found in Scan::new(self, collection, &mut Arc::new(Filter::parse(&Document::new())?))? {
            let found = found?;
            self.note(ns, Noted::delete(&found.body, found.position).of_history())?;
        }
        let collation = self.collation(Some(collection), Modifiers::none())?;
        let definition = collation.map(|collation| RawDocumentBuf::try_from(collation.definition())).transpose();
        self.note(ns, Noted { before: definition.map_err(QueryError::from)?.as_deref(), ..drop })
    }

    /// Appends the end of a database, where all of it is watched: it is a change of none of its collections.
    pub(super) fn note_drop_database(&self, database: &str) -> Result<(), StoreError> {
        let ns = Namespace { database: database.to_owned(), collection: String::new() };
        if !self.wanted(&ns)?.by_streams {
            return Ok(());
        }
        self.append(&ns, Noted::drop_database()).map_err(|e| self.explain(&e))
    }

    /// Appends the rename itself, behind what it is for watches and histories, where a stream of either name is told of it.
    pub(super) fn note_names(&self, from: &Namespace, to: &Namespace, names: &RawDocument) -> Result<(), StoreError> {
        if !self.wanted(from)?.by_streams && !self.wanted(to)?.by_streams {
            return Ok(());
        }
        let ns = Namespace { database: to.database.clone(), collection: String::new() };
        self.append(&ns, Noted::rename(names)).map_err(|e| self.explain(&e))
    }

    /// Appends the changes of a rename: a drop of the old name, and for watches and the history of the new
    /// name an insert of each document. `names` are as in [`Embedded::note_drop`].
    pub(super) fn note_rename(
        &self,
        collection: Collection,
        (from, to): (&Namespace, &Namespace),
        names: Option<&RawDocument>,
    ) -> Result<(), StoreError> {
        self.note_drop(from, collection, names)?;
        let wanted = self.wanted(to)?;
        let is_for_streams = wanted.by_streams && names.is_none();
        if !wanted.by_watches && wanted.by_history.is_none() && !is_for_streams {
            return Ok(());
        }
        for found in Scan::new(self, collection, &mut Arc::new(Filter::parse(&Document::new())?))? {
            let found = found?;
            let noted = match names {
                Some(_) => Noted::arrival(&found.body, found.position),
                None => Noted::insert(&found.body, found.position),
            };
            self.note(to, noted)?;
        }
        Ok(())
    }

    /// The watchers of a collection. In a write transaction only.
    fn wanted(&self, ns: &Namespace) -> Result<Wanted, StoreError> {
        if self.place == Place::Memory {
            return Ok(Wanted { by_watches: false, by_streams: false, by_history: None });
        }
        let mut watched = self.log.watched.borrow_mut();
        if watched.is_none() {
            *watched = Some(look(&self.connection).map_err(|e| self.explain(&e))?);
        }
        let any = |patterns: &[Namespace]| patterns.iter().any(|kept| watcher::covers(kept, ns));
        let by_history = |watched: &Watched| history::choose(&watched.histories, ns).map(|kept| kept.size);
        Ok(Wanted {
            by_watches: watched.as_ref().is_some_and(|watched| any(&watched.watches)),
            by_streams: watched.as_ref().is_some_and(|watched| any(&watched.streams)),
            by_history: watched.as_ref().and_then(by_history),
        })
    }

    /// To be called when the set of watches has changed within a write transaction.
    pub(super) fn look_again(&self) {
        self.log.watched.replace(None);
    }

    /// Resets the log. Called when a write transaction begins.
    pub(super) fn open_log(&self) -> Result<(), StoreError> {
        self.log.watched.replace(None);
        self.log.noted.set(false);
        if self.place == Place::Memory {
            return Ok(());
        }
        self.log.keeping.renew(&self.connection).map_err(|e| self.explain(&e))
    }

    /// Bounds the size of the log. Called before a write transaction is committed.
    pub(super) fn bound_log(&self) -> Result<(), StoreError> {
        if !self.log.noted.get() {
            return Ok(());
        }
        let watched = self.log.watched.borrow();
        let histories = watched.as_ref().map(|watched| watched.histories.as_slice()).unwrap_or_default();
        let bound = || {
            history::bound(&self.connection, histories)?;
            let most = histories.iter().fold(LARGEST, |most, kept| most.saturating_add(kept.size));
            change_log::bound(&self.connection, most, |last| history::cut(&self.connection, histories, last))
        };
        bound().map_err(|e| self.explain(&e))
    }

    /// Notifies watchers. Called after a write transaction was committed.
    pub(super) fn publish_log(&self) {
        if !self.log.noted.replace(false) {
            return;
        }
        self.log.committed.set(Some((self.log.first.get(), self.log.last.get())));
        if let Place::File(path) = &self.place {
            notifier::notify(path);
        }
    }
}

/// What is watched, and which histories are kept. In a write transaction only.
fn look(connection: &Connection) -> rusqlite::Result<Watched> {
    let watcher::Audience { watches, streams, has_histories } = watcher::audience(connection)?;
    let histories = if has_histories { history::current(connection)? } else { Vec::new() };
    Ok(Watched { watches, streams, histories })
}
