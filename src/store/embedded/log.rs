//! The change log: what was changed, for those who watch.
//!
//! A change is noted in the transaction that makes it, and only where somebody
//! watches its collection, so that a memory which nobody watches pays nothing.
//! What all watchers of a collection are done with is removed. What an abandoned or
//! slow one keeps is bounded by [`LARGEST`], as by the size of an oplog: past it the
//! oldest changes go, and a watcher that had not seen them is told so ([`super::feed`]).

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use bson::{DateTime, Document, RawDocument};
use rusqlite::{Connection, OptionalExtension as _, params};

use super::catalog::Collection;
use super::scan::Scan;
use super::{Embedded, Place, notifier, watcher};
use crate::query::Filter;
use crate::store::{ChangeKind, Namespace, StoreError};

/// At most so many bytes of changes wait for those who watch.
pub(super) const LARGEST: i64 = 256 << 20;

/// What a noted change costs beyond its documents.
const OVERHEAD: usize = 64;

/// What the write transaction in progress knows of the log.
#[derive(Default)]
pub(super) struct Log {
    /// The collections that are watched, once somebody asked.
    watched: RefCell<Option<Vec<Namespace>>>,
    /// Whether something was noted.
    noted: Cell<bool>,
}

/// A change that is being made.
#[derive(Clone, Copy)]
pub(super) struct Noted<'a> {
    pub(super) kind: ChangeKind,
    pub(super) before: Option<&'a RawDocument>,
    pub(super) after: Option<&'a RawDocument>,
}

impl<'a> Noted<'a> {
    pub(super) fn insert(after: &'a RawDocument) -> Self {
        Self { kind: ChangeKind::Insert, before: None, after: Some(after) }
    }

    pub(super) fn delete(before: &'a RawDocument) -> Self {
        Self { kind: ChangeKind::Delete, before: Some(before), after: None }
    }

    pub(super) fn drop() -> Self {
        Self { kind: ChangeKind::Drop, before: None, after: None }
    }
}

impl Embedded {
    /// Notes a change where somebody watches the collection. Every write path
    /// calls this, in its transaction.
    pub(super) fn note(&self, ns: &Namespace, noted: Noted<'_>) -> Result<(), StoreError> {
        if !self.is_watched(ns)? {
            return Ok(());
        }
        self.log.noted.set(true);
        append(&self.connection, ns, noted).map_err(|e| self.explain(&e))
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
            true => bound(&self.connection, LARGEST).map_err(|e| self.explain(&e)),
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

fn append(connection: &Connection, ns: &Namespace, noted: Noted<'_>) -> rusqlite::Result<()> {
    let bytes = |document: Option<&'_ RawDocument>| document.map_or(0, |document| document.as_bytes().len());
    let size = i64::try_from(bytes(noted.before) + bytes(noted.after) + OVERHEAD).unwrap_or(i64::MAX);
    let sql = "INSERT INTO changes (database, collection, kind, time, before, after, volume) VALUES (?, ?, ?, ?, ?, ?,
               ? + coalesce((SELECT volume FROM changes ORDER BY sequence DESC LIMIT 1), 0))";
    connection
        .prepare_cached(sql)?
        .execute(params![
            ns.database,
            ns.collection,
            code(noted.kind),
            DateTime::now().timestamp_millis(),
            noted.before.map(RawDocument::as_bytes),
            noted.after.map(RawDocument::as_bytes),
            size,
        ])
        .map(|_| ())
}

/// Removes the oldest changes where there are more than `most` bytes of them, and
/// marks the watchers that have missed some by that.
fn bound(connection: &Connection, most: i64) -> rusqlite::Result<()> {
    let sql = "SELECT max(volume) - min(volume) FROM (
                   SELECT * FROM (SELECT volume FROM changes ORDER BY sequence LIMIT 1)
                   UNION ALL SELECT * FROM (SELECT volume FROM changes ORDER BY sequence DESC LIMIT 1))";
    let kept: Option<i64> = connection.prepare_cached(sql)?.query_row([], |row| row.get(0))?;
    if kept.is_none_or(|kept| kept <= most) {
        return Ok(());
    }
    // A quarter goes at once, so that this is not done for every change.
    let sql = "SELECT sequence FROM changes WHERE volume < (SELECT max(volume) FROM changes) - ?
               ORDER BY sequence DESC LIMIT 1";
    let last: Option<i64> = connection.query_row(sql, [most / 4 * 3], |row| row.get(0)).optional()?;
    let Some(last) = last else { return Ok(()) };
    connection.execute(
        "UPDATE watchers SET missed = 1 WHERE position < ?1 AND EXISTS (
             SELECT 1 FROM changes WHERE database = watchers.database AND collection = watchers.collection
                                     AND sequence > watchers.position AND sequence <= ?1)",
        [last],
    )?;
    connection.execute("DELETE FROM changes WHERE sequence <= ?", [last]).map(|_| ())
}

/// Removes the changes of a collection that nobody waits for.
pub(super) fn trim(connection: &Connection, ns: &Namespace) -> rusqlite::Result<()> {
    let sql = "DELETE FROM changes WHERE database = ?1 AND collection = ?2 AND sequence <= coalesce((
                   SELECT min(position) FROM watchers WHERE database = ?1 AND collection = ?2 AND missed = 0),
                   9223372036854775807)";
    connection.prepare_cached(sql)?.execute(params![ns.database, ns.collection]).map(|_| ())
}

/// The number of the last change that was ever noted.
pub(super) fn last(connection: &Connection) -> rusqlite::Result<i64> {
    let sql = "SELECT coalesce((SELECT seq FROM sqlite_sequence WHERE name = 'changes'), 0)";
    connection.prepare_cached(sql)?.query_row([], |row| row.get(0))
}

fn code(kind: ChangeKind) -> i64 {
    match kind {
        ChangeKind::Insert => 0,
        ChangeKind::Update => 1,
        ChangeKind::Replace => 2,
        ChangeKind::Delete => 3,
        ChangeKind::Drop => 4,
    }
}

/// The kind that was stored as a number.
pub(super) fn kind(code: i64) -> Option<ChangeKind> {
    use ChangeKind::{Delete, Drop, Insert, Replace, Update};
    [Insert, Update, Replace, Delete, Drop].into_iter().find(|kind| self::code(*kind) == code)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::rawdoc;

    fn numbers(store: &Embedded, sql: &str) -> Vec<i64> {
        let mut statement = store.connection.prepare(sql).unwrap();
        statement.query_map([], |row| row.get(0)).unwrap().collect::<rusqlite::Result<_>>().unwrap()
    }

    #[test]
    fn a_log_that_is_too_large_loses_its_oldest_changes_and_says_who_missed_them() {
        let store = Embedded::in_memory().unwrap();
        let ns = |name: &str| Namespace { database: "a".into(), collection: name.into() };
        for (name, position) in [("slow", 0), ("quick", 9), ("slow of another", 0)] {
            let sql = "INSERT INTO watchers (name, database, collection, position, beat) VALUES (?, 'a', ?, ?, 0)";
            let collection = if name == "slow of another" { "c" } else { "b" };
            store.connection.execute(sql, params![name, collection, position]).unwrap();
        }
        for _ in 0..10 {
            let document = rawdoc! { "pad": "x".repeat(1_000) };
            append(&store.connection, &ns("b"), Noted::insert(&document)).unwrap();
        }
        bound(&store.connection, 100_000).unwrap();
        assert_eq!(numbers(&store, "SELECT sequence FROM changes").len(), 10);
        bound(&store.connection, 5_000).unwrap();
        assert_eq!(numbers(&store, "SELECT sequence FROM changes"), [7, 8, 9, 10]);
        assert_eq!(numbers(&store, "SELECT missed FROM watchers ORDER BY id"), [1, 0, 0]);
        trim(&store.connection, &ns("b")).unwrap();
        assert_eq!(numbers(&store, "SELECT sequence FROM changes"), [10]);
        assert_eq!(last(&store.connection).unwrap(), 10);
    }
}
