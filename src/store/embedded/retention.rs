//! Changes that are kept for a while, for change streams that resume.
//!
//! A row of `watchers` says so, as for named watches ([`super::watcher`]); an empty name of
//! a collection, or of a database too, stands for all. The row's position lags behind the last
//! change, so that whoever was disconnected, or finds the server started again, misses nothing.

use bson::DateTime;
use rusqlite::{Connection, OptionalExtension as _, params};

use super::change_log::{ARRIVED, DROPPED, RENAMED};
use super::feed::{self, Logged};
use super::page::PageError;
use super::place::Place;
use super::snapshot::Snapshot;
use super::{Embedded, change_log, watcher};
use crate::process::holder::Holder;
use crate::query::QueryError;
use crate::store::{ChangePage, Kept, Namespace, Scope, Since, StoreError};

/// MongoDB's code for changes that are not kept any more.
const HISTORY_LOST: i32 = 286;
/// A page ends after about so many bytes.
const PAGE_BYTES: usize = 4 << 20;

impl Embedded {
    /// Keeps the changes of a scope, and lets go of those from before `since`.
    pub(super) fn retain(&self, scope: &Scope, since: DateTime) -> Result<Kept, StoreError> {
        if self.place == Place::Memory {
            let reason = "no other process can change a memory in this process, so no changes are kept".to_owned();
            return Err(StoreError::Unfit { address: self.place.to_string(), reason });
        }
        self.write(|| {
            self.look_again();
            retain(&self.connection, scope, since).map_err(|e| self.explain(&e))
        })
    }

    /// Stops keeping the changes of a scope.
    pub(super) fn release(&self, scope: &Scope) -> Result<(), StoreError> {
        let release = || {
            self.look_again();
            self.connection.execute("DELETE FROM watchers WHERE name = ?", [name(scope)])?;
            trim(&self.connection, &pattern(scope))
        };
        self.write(|| release().map_err(|e| self.explain(&e)))
    }

    /// The scopes whose changes are kept.
    pub(super) fn retained(&self) -> Result<Vec<Scope>, StoreError> {
        let read = || -> rusqlite::Result<Vec<Scope>> {
            let sql = "SELECT database, collection FROM watchers WHERE substr(name, 1, length(?1)) = ?1";
            let mut statement = self.connection.prepare_cached(sql)?;
            let rows = statement.query_map([change_log::PREFIX], |row| Ok(scope(row.get(0)?, row.get(1)?)))?;
            rows.collect()
        };
        read().map_err(|e| self.explain(&e))
    }

    /// The changes of a scope behind a position, read at one moment.
    pub(super) fn changes_behind(&self, scope: &Scope, behind: i64, most: usize) -> Result<ChangePage, StoreError> {
        let _snapshot = Snapshot::begin(&self.connection).map_err(|e| self.explain(&e))?;
        let from = position(&self.connection, scope).map_err(|e| self.explain(&e))?;
        let last = change_log::last(&self.connection).map_err(|e| self.explain(&e))?;
        if from.is_none_or(|from| behind < from) || behind > last {
            return Err(lost(scope).into());
        }
        self.page(scope, behind, last, most)
    }

    /// The changes behind a position and up to the last one.
    fn page(&self, scope: &Scope, behind: i64, last: i64, most: usize) -> Result<ChangePage, StoreError> {
        // The renames of a collection are among the changes of its database.
        let rename = match scope {
            Scope::Collection(ns) => self.rename_behind(ns, behind)?,
            Scope::Database(_) | Scope::All => None,
        };
        let end = rename.as_ref().map_or(last, |rename| rename.sequence);
        let condition = match scope {
            Scope::Collection(_) => "database = ?2 AND collection = ?3",
            Scope::Database(_) => "database = ?2 AND ?3 = ''",
            Scope::All => "?2 = '' AND ?3 = ''",
        };
        let sql = format!(
            "SELECT sequence, kind, time, before, after, database, collection FROM changes \
             WHERE sequence > ?1 AND {condition} AND kind NOT IN ({DROPPED}, {ARRIVED}) AND sequence <= ?4
             ORDER BY sequence"
        );
        let pattern = pattern(scope);
        let mut statement = self.connection.prepare_cached(&sql).map_err(|e| self.explain(&e))?;
        let rows = statement.query(params![behind, pattern.database, pattern.collection, end]);
        let mut rows = rows.map_err(|e| self.explain(&e))?;
        let (mut page, mut bytes) = (ChangePage { changes: Vec::new(), until: behind }, 0);
        while page.changes.len() < most && bytes < PAGE_BYTES {
            let Some(row) = rows.next().map_err(|e| self.explain(&e))? else {
                page.until = end;
                if let (Some(Logged { change, .. }), Scope::Collection(ns)) = (rename, scope) {
                    page.changes.push((ns.clone(), change));
                }
                break;
            };
            let logged = feed::logged(row).map_err(|error| self.explain_page(&pattern, error))?;
            let Logged { sequence, change, is_of_rename } = logged;
            let named = || Ok(Namespace { database: row.get(5)?, collection: row.get(6)? });
            bytes +=
                [&change.before, &change.after].into_iter().flatten().map(|raw| raw.as_bytes().len()).sum::<usize>();
            page.until = sequence;
            let ns = named().map_err(|e| self.explain(&e))?;
            // Collections that rmem keeps for itself are not reported.
            if !is_of_rename && watcher::covers(&pattern, &ns) {
                page.changes.push((ns, change));
            }
        }
        Ok(page)
    }

    /// The first rename from or to a name behind a position.
    fn rename_behind(&self, ns: &Namespace, behind: i64) -> Result<Option<Logged>, StoreError> {
        let sql = format!(
            "SELECT sequence, kind, time, before, after FROM changes
             WHERE database = ? AND collection = '' AND sequence > ? AND kind = {RENAMED} ORDER BY sequence"
        );
        let find = || -> Result<Option<Logged>, PageError> {
            let mut statement = self.connection.prepare_cached(&sql)?;
            let mut rows = statement.query(params![ns.database, behind])?;
            while let Some(row) = rows.next()? {
                let rename = feed::logged(row)?;
                let names = rename.change.after.as_deref();
                let is_named =
                    |field| names.is_some_and(|names| names.get_str(field).is_ok_and(|name| name == ns.collection));
                if is_named("from") || is_named("to") {
                    return Ok(Some(rename));
                }
            }
            Ok(None)
        };
        find().map_err(|error| self.explain_page(ns, error))
    }

    /// Where the kept changes at or after a time begin.
    pub(super) fn before(&self, scope: &Scope, time: DateTime) -> Result<Since, StoreError> {
        let read = || -> rusqlite::Result<Option<Since>> {
            let Some(from) = position(&self.connection, scope)? else { return Ok(None) };
            let sql = "SELECT coalesce(min(sequence) - 1, ?2) FROM changes WHERE time >= ?1";
            let last = change_log::last(&self.connection)?;
            let first: i64 = self
                .connection
                .prepare_cached(sql)?
                .query_row(params![time.timestamp_millis(), last], |row| row.get(0))?;
            let sql = "SELECT 1 FROM changes WHERE sequence > ?1 AND time < ?2 LIMIT 1";
            let is_whole = self.connection.prepare_cached(sql)?.exists(params![from, time.timestamp_millis()])?;
            Ok(Some(Since { position: first.max(from), is_whole }))
        };
        read().map_err(|e| self.explain(&e))?.ok_or_else(|| lost(scope).into())
    }
}

/// Makes, or moves on, the row of a scope. In a write transaction only.
fn retain(connection: &Connection, scope: &Scope, since: DateTime) -> rusqlite::Result<Kept> {
    let (pattern, last) = (pattern(scope), change_log::last(connection)?);
    let (holder, now) = (Holder::myself().to_string(), DateTime::now().timestamp_millis());
    let Some(from) = position(connection, scope)? else {
        // What is kept for a wider scope is kept for this one, too.
        let sql = "SELECT coalesce(min(position), ?3) FROM watchers
                   WHERE missed = 0 AND database IN ('', ?1) AND collection IN ('', ?2) AND substr(name, 1, length(?4)) = ?4";
        let wider = params![pattern.database, pattern.collection, last, change_log::PREFIX];
        let from: i64 = connection.prepare_cached(sql)?.query_row(wider, |row| row.get(0))?;
        let sql = "INSERT INTO watchers (name, database, collection, position, holder, beat) VALUES (?, ?, ?, ?, ?, ?)";
        connection.execute(sql, params![name(scope), pattern.database, pattern.collection, from, holder, now])?;
        return Ok(Kept { from, last, is_new: from == last });
    };
    let sql = "SELECT coalesce(max(sequence), 0) FROM changes WHERE sequence > ?1 AND time < ?2";
    let old: i64 =
        connection.prepare_cached(sql)?.query_row(params![from, since.timestamp_millis()], |row| row.get(0))?;
    let from = from.max(old);
    let sql = "UPDATE watchers SET position = ?, holder = ?, beat = ? WHERE name = ?";
    connection.prepare_cached(sql)?.execute(params![from, holder, now, name(scope)])?;
    trim(connection, &pattern)?;
    Ok(Kept { from, last, is_new: false })
}

/// Removes the changes of a pattern that all who follow them are done with.
fn trim(connection: &Connection, pattern: &Namespace) -> rusqlite::Result<()> {
    change_log::trim(connection, pattern)?;
    change_log::trim_renames(connection, &pattern.database)
}

/// The position behind which all changes of a scope are kept.
fn position(connection: &Connection, scope: &Scope) -> rusqlite::Result<Option<i64>> {
    let sql = "SELECT position FROM watchers WHERE name = ?";
    connection.prepare_cached(sql)?.query_row([name(scope)], |row| row.get(0)).optional()
}

fn lost(scope: &Scope) -> QueryError {
    let of = match scope {
        Scope::Collection(ns) => ns.to_string(),
        Scope::Database(database) => format!("the database {database}"),
        Scope::All => "this memory".to_owned(),
    };
    QueryError::invalid(HISTORY_LOST, format!("changes of {of} since then are not kept any more; read it anew"))
}

/// A scope as it is written in a row: with empty names for all.
fn pattern(scope: &Scope) -> Namespace {
    match scope {
        Scope::Collection(ns) => ns.clone(),
        Scope::Database(database) => Namespace { database: database.clone(), collection: String::new() },
        Scope::All => Namespace { database: String::new(), collection: String::new() },
    }
}

fn scope(database: String, collection: String) -> Scope {
    match (database.is_empty(), collection.is_empty()) {
        (true, _) => Scope::All,
        (false, true) => Scope::Database(database),
        (false, false) => Scope::Collection(Namespace { database, collection }),
    }
}

fn name(scope: &Scope) -> String {
    let Namespace { database, collection } = pattern(scope);
    format!("{}{database}.{collection}", change_log::PREFIX)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::store::{ChangeKind, Store as _};
    use bson::doc;

    fn ns(name: &str) -> Namespace {
        Namespace { database: "a".to_owned(), collection: name.to_owned() }
    }

    #[test]
    fn a_rename_keeps_one_change_for_streams_and_no_document() {
        let folder = tempfile::tempdir().unwrap();
        let store = Embedded::open(folder.path().join("x.rmem")).unwrap();
        let hour = DateTime::from_millis(DateTime::now().timestamp_millis() - 3_600_000);
        store.insert(&ns("b"), (0..100).map(|id| doc! { "_id": id }).collect()).unwrap();
        let [b, c] = ["b", "c"].map(|name| Scope::Collection(ns(name)));
        let last = [&b, &c, &Scope::All].map(|scope| store.keep_changes(scope, hour).unwrap().last)[0];
        store.rename(&ns("b"), &ns("c"), false).unwrap();
        let count =
            || -> i64 { store.connection.query_row("SELECT count(*) FROM changes", [], |row| row.get(0)).unwrap() };
        assert_eq!(count(), 1);
        for scope in [&b, &c, &Scope::All] {
            let page = store.changes(scope, last, 100).unwrap();
            let kinds: Vec<_> = page.changes.iter().map(|(_, change)| change.kind).collect();
            assert_eq!((kinds, page.until), (vec![ChangeKind::Rename], last + 1));
        }
        // It is kept until the last of them is done with it.
        std::thread::sleep(Duration::from_millis(5));
        for (scope, left) in [(&Scope::All, 1), (&b, 1), (&c, 0)] {
            store.keep_changes(scope, DateTime::now()).unwrap();
            assert_eq!(count(), left);
        }
    }

    #[test]
    fn changes_are_kept_for_a_scope_until_they_are_old() {
        let folder = tempfile::tempdir().unwrap();
        let store = Embedded::open(folder.path().join("x.rmem")).unwrap();
        let hour = DateTime::from_millis(DateTime::now().timestamp_millis() - 3_600_000);
        let one = store.keep_changes(&Scope::Collection(ns("b")), hour).unwrap();
        let all = store.keep_changes(&Scope::Database("a".to_owned()), hour).unwrap();
        for name in ["b", "c", "rmem.own"] {
            store.insert(&ns(name), vec![doc! { "_id": 1 }]).unwrap();
        }
        let names = |scope: &Scope, behind| {
            let page = store.changes(scope, behind, 100).unwrap();
            page.changes.into_iter().map(|(ns, _)| ns.collection).collect::<Vec<_>>()
        };
        assert_eq!(names(&Scope::Collection(ns("b")), one.last), ["b"]);
        assert_eq!(names(&Scope::Database("a".to_owned()), all.last), ["b", "c"]);
        // Behind a page of what rmem keeps for itself, too.
        let own = Scope::Collection(ns("rmem.own"));
        let last = store.keep_changes(&own, hour).unwrap().last;
        store.insert(&ns("rmem.own"), (2..9).map(|id| doc! { "_id": id }).collect()).unwrap();
        store.insert(&ns("c"), vec![doc! { "_id": 2 }]).unwrap();
        assert_eq!(store.changes(&Scope::Database("a".to_owned()), last, 3).unwrap().changes.len(), 1);
        store.release_changes(&own).unwrap();
        assert!(store.names().unwrap().is_empty());
        store.release_changes(&Scope::Database("a".to_owned())).unwrap();
        assert_eq!(store.kept_scopes().unwrap(), [Scope::Collection(ns("b"))]);
        std::thread::sleep(Duration::from_millis(5));
        store.keep_changes(&Scope::Collection(ns("b")), DateTime::now()).unwrap();
        match store.changes(&Scope::Collection(ns("b")), one.last, 100).unwrap_err() {
            StoreError::Query(error) => assert_eq!(error.code, HISTORY_LOST),
            other => panic!("{other}"),
        }
    }
}
