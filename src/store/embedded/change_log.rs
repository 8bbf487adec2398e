//! The table of changes: what was changed, kept until every watcher has taken it.
//!
//! The documents in it are stored as those of collections are, with a checksum ([`body`]); an earlier rmem stored them without.
//! Changes that all watchers of a collection are done with are removed. An abandoned or slow
//! watcher keeps at most [`LARGEST`] bytes of them, as an oplog has a largest size: past it the
//! oldest changes are removed, and the watchers that had not taken them are marked.

use bson::RawDocument;
use rusqlite::{Connection, OptionalExtension as _, Row, params};

use super::body;
use crate::monotonic;
use crate::saturate::to_i64;
use crate::store::{ChangeKind, Namespace};

/// What the names of those watchers begin with that keep changes for whoever comes back.
pub(super) const PREFIX: &str = "rmem.serve:";
/// The most bytes of changes that are kept for watchers.
pub(super) const LARGEST: i64 = 256 << 20;

/// The bytes that a change takes beside its documents.
const OVERHEAD: usize = 64;

/// The number of a deletion that watchers do not get: the collection goes as a whole.
pub(super) const DROPPED: i64 = 5;
/// The number of a drop whose documents are too large for the history.
const DROPPED_UNKEPT: i64 = 6;
/// The number of an insert that a rename makes for watches and histories of the new name.
pub(super) const ARRIVED: i64 = 8;
/// The number of a rename as streams are told of it: a change of the database, with an empty name of a collection.
pub(super) const RENAMED: i64 = 9;

/// A change to be appended.
#[derive(Clone, Copy)]
pub(super) struct Noted<'a> {
    pub(super) kind: ChangeKind,
    pub(super) before: Option<&'a RawDocument>,
    pub(super) after: Option<&'a RawDocument>,
    /// The position of the document in its collection.
    pub(super) place: Option<i64>,
    pub(super) role: Role,
}

/// What sets a change apart from others of its kind.
#[derive(Clone, Copy)]
pub(super) enum Role {
    /// Nothing.
    Plain,
    /// A deletion for the history alone, or a drop without its documents.
    OfHistory,
    /// An insert that stands for a document of a renamed collection.
    Arrival,
}

impl<'a> Noted<'a> {
    pub(super) fn insert(after: &'a RawDocument, place: i64) -> Self {
        Self { after: Some(after), place: Some(place), ..Self::of(ChangeKind::Insert) }
    }

    pub(super) fn change(kind: ChangeKind, before: &'a RawDocument, after: &'a RawDocument, place: i64) -> Self {
        Self { before: Some(before), after: Some(after), place: Some(place), ..Self::of(kind) }
    }

    pub(super) fn delete(before: &'a RawDocument, place: i64) -> Self {
        Self { before: Some(before), place: Some(place), ..Self::of(ChangeKind::Delete) }
    }

    /// A drop; `collation` is the definition of that of the collection, for the history.
    pub(super) fn drop(collation: Option<&'a RawDocument>) -> Self {
        Self { before: collation, ..Self::of(ChangeKind::Drop) }
    }

    /// The same, by a rename with these names: streams are told of that.
    pub(super) fn by_rename(self, names: Option<&'a RawDocument>) -> Self {
        Self { after: names, ..self }
    }

    /// A rename with these names ([`ChangeKind::Rename`]).
    pub(super) fn rename(names: &'a RawDocument) -> Self {
        Self { after: Some(names), ..Self::of(ChangeKind::Rename) }
    }

    /// An insert that stands for a document of a renamed collection.
    pub(super) fn arrival(after: &'a RawDocument, place: i64) -> Self {
        Self { role: Role::Arrival, ..Self::insert(after, place) }
    }

    /// The end of a database.
    pub(super) fn drop_database() -> Self {
        Self::of(ChangeKind::DropDatabase)
    }

    /// A change of no document.
    fn of(kind: ChangeKind) -> Self {
        Self { kind, before: None, after: None, place: None, role: Role::Plain }
    }

    /// The same, for the history.
    pub(super) fn of_history(self) -> Self {
        Self { role: Role::OfHistory, ..self }
    }

    /// Whether only histories get it.
    pub(super) fn is_of_history_alone(self) -> bool {
        self.code() == DROPPED
    }

    /// Whether streams get it: of a rename, they get that.
    pub(super) fn is_for_streams(self) -> bool {
        let is_of_rename = self.kind == ChangeKind::Drop && self.after.is_some();
        !is_of_rename && !matches!(self.code(), DROPPED | ARRIVED)
    }

    fn code(self) -> i64 {
        match (self.kind, self.role) {
            (ChangeKind::Delete, Role::OfHistory) => DROPPED,
            (ChangeKind::Drop, Role::OfHistory) => DROPPED_UNKEPT,
            (ChangeKind::Insert, Role::Arrival) => ARRIVED,
            (kind, _) => code(kind),
        }
    }
}

pub(super) fn append(connection: &Connection, ns: &Namespace, noted: Noted<'_>) -> rusqlite::Result<()> {
    let bytes = |document: Option<&'_ RawDocument>| document.map_or(0, |document| document.as_bytes().len());
    let size = to_i64(bytes(noted.before) + bytes(noted.after) + OVERHEAD);
    let sql = "INSERT INTO changes (database, collection, kind, time, before, after, volume) VALUES (?, ?, ?, ?, ?, ?,
               ? + coalesce((SELECT volume FROM changes ORDER BY sequence DESC LIMIT 1), 0))";
    connection
        .prepare_cached(sql)?
        .execute(params![
            ns.database,
            ns.collection,
            noted.code(),
            monotonic::now().timestamp_millis(),
            noted.before.map(body::seal),
            noted.after.map(body::seal),
            size,
        ])
        .map(|_| ())
}

/// Removes the oldest changes where there are more than `most` bytes of them, and
/// marks the watchers that had not taken them. `before` gets the last change that goes.
pub(super) fn bound(
    connection: &Connection,
    most: i64,
    before: impl FnOnce(i64) -> rusqlite::Result<()>,
) -> rusqlite::Result<()> {
    let sql = "SELECT max(volume) - min(volume) FROM (
                   SELECT * FROM (SELECT volume FROM changes ORDER BY sequence LIMIT 1)
                   UNION ALL SELECT * FROM (SELECT volume FROM changes ORDER BY sequence DESC LIMIT 1))";
    let kept: Option<i64> = connection.prepare_cached(sql)?.query_row([], |row| row.get(0))?;
    if kept.is_none_or(|kept| kept <= most) {
        return Ok(());
    }
    // A quarter is removed at once, so that this is not done for every change.
    let sql = "SELECT sequence FROM changes WHERE volume < (SELECT max(volume) FROM changes) - ?
               ORDER BY sequence DESC LIMIT 1";
    let last: Option<i64> = connection.query_row(sql, [most / 4 * 3], |row| row.get(0)).optional()?;
    last.map_or(Ok(()), |last| cut(connection, last, before))
}

/// Removes the changes up to `last`, and marks the watchers that had not taken them. `before` gets `last`.
pub(super) fn cut(
    connection: &Connection,
    last: i64,
    before: impl FnOnce(i64) -> rusqlite::Result<()>,
) -> rusqlite::Result<()> {
    move_on(connection, last)?;
    before(last)?;
    connection.execute(
        "UPDATE watchers SET missed = 1 WHERE position < ?1 AND EXISTS (
             SELECT 1 FROM changes WHERE database = watchers.database AND collection = watchers.collection
                                     AND sequence > watchers.position AND sequence <= ?1)",
        [last],
    )?;
    connection.execute("DELETE FROM changes WHERE sequence <= ?", [last]).map(|_| ())
}

/// Removes the changes of a collection that all its watchers are done with.
pub(super) fn trim(connection: &Connection, ns: &Namespace) -> rusqlite::Result<()> {
    if ns.collection.is_empty() {
        return trim_pattern(connection, ns);
    }
    let sql = "DELETE FROM changes WHERE database = ?1 AND collection = ?2 AND sequence <= coalesce((
                   SELECT min(position) FROM watchers
                   WHERE database IN ('', ?1) AND collection IN ('', ?2) AND missed = 0), 9223372036854775807)";
    connection.prepare_cached(sql)?.execute(params![ns.database, ns.collection]).map(|_| ())
}

/// Removes the renames in a database, or everywhere, that all streams are done with.
pub(super) fn trim_renames(connection: &Connection, database: &str) -> rusqlite::Result<()> {
    // One database is found by the index: each stream that is opened asks this.
    let these = if database.is_empty() { "?1 = ''" } else { "database = ?1" };
    let sql = format!(
        "DELETE FROM changes WHERE {these} AND collection = '' AND kind = {RENAMED} AND sequence <= coalesce((
             SELECT min(position) FROM watchers WHERE missed = 0 AND substr(name, 1, length(?2)) = ?2
             AND watchers.database IN ('', changes.database)), 9223372036854775807)"
    );
    connection.prepare_cached(&sql)?.execute(params![database, PREFIX]).map(|_| ())
}

/// Moves those on that keep changes up to `last`, which are about to be removed.
fn move_on(connection: &Connection, last: i64) -> rusqlite::Result<()> {
    let sql = "UPDATE watchers SET position = ?2 WHERE substr(name, 1, length(?1)) = ?1 AND position < ?2";
    connection.execute(sql, params![PREFIX, last]).map(|_| ())
}

/// Removes the changes of a pattern that no watch waits for.
fn trim_pattern(connection: &Connection, pattern: &Namespace) -> rusqlite::Result<()> {
    let sql = format!(
        "DELETE FROM changes WHERE ?1 IN ('', database) AND ?2 IN ('', collection) AND kind <> {RENAMED}
         AND sequence <= coalesce((
             SELECT min(position) FROM watchers WHERE missed = 0
             AND watchers.database IN ('', changes.database)
             AND watchers.collection IN ('', changes.collection)), 9223372036854775807)"
    );
    connection.prepare_cached(&sql)?.execute(params![pattern.database, pattern.collection]).map(|_| ())
}

/// The number of the last change that was ever appended.
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
        ChangeKind::DropDatabase => 7,
        ChangeKind::Rename => RENAMED,
    }
}

/// The kind that was stored as a number.
pub(super) fn kind(code: i64) -> Option<ChangeKind> {
    use ChangeKind::{Delete, Drop, DropDatabase, Insert, Rename, Replace, Update};
    match code {
        DROPPED => Some(Delete),
        DROPPED_UNKEPT => Some(Drop),
        ARRIVED => Some(Insert),
        code => {
            let all = [Insert, Update, Replace, Delete, Drop, DropDatabase, Rename];
            all.into_iter().find(|kind| self::code(*kind) == code)
        }
    }
}

/// Calls `report` for each damaged change, with its number and what is wrong.
pub(super) fn find_damage(connection: &Connection, report: &mut dyn FnMut(i64, String)) -> rusqlite::Result<()> {
    let mut statement = connection.prepare("SELECT sequence, before, after, kind FROM changes ORDER BY sequence")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        if let Err(wrong) = verify(row) {
            report(row.get("sequence")?, wrong);
        }
    }
    Ok(())
}

/// Checks a row of the log; the error says what is wrong with it.
fn verify(row: &Row<'_>) -> Result<(), String> {
    let read = |column: &str| match row.get_ref(column).and_then(|stored| Ok(stored.as_blob_or_null()?)) {
        Ok(None) => Ok(()),
        Ok(Some(stored)) => match body::open(stored) {
            Ok(_) => Ok(()),
            Err(damage) => {
                let of = body::name(stored).map(|id| format!("the document with _id {id}: ")).unwrap_or_default();
                Err(format!("{of}{}", damage.describe()))
            }
        },
        Err(error) => Err(error.to_string()),
    };
    read("before").and_then(|()| read("after"))?;
    match row.get("kind").map(kind) {
        Ok(Some(_)) => Ok(()),
        _ => Err("its kind is unknown".to_owned()),
    }
}

/// Whether the number is one that only the history has.
pub(super) fn is_of_history(code: i64) -> bool {
    code == DROPPED || code == DROPPED_UNKEPT
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::rawdoc;

    fn numbers(store: &crate::store::Embedded, sql: &str) -> Vec<i64> {
        let mut statement = store.connection.prepare(sql).unwrap();
        statement.query_map([], |row| row.get(0)).unwrap().collect::<rusqlite::Result<_>>().unwrap()
    }

    #[test]
    fn a_log_that_is_too_large_loses_its_oldest_changes_and_marks_the_watchers_that_missed_them() {
        let store = crate::store::Embedded::in_memory().unwrap();
        let ns = |name: &str| Namespace { database: "a".into(), collection: name.into() };
        for (name, position) in [("slow", 0), ("quick", 9), ("slow of another", 0)] {
            let sql = "INSERT INTO watchers (name, database, collection, position, beat) VALUES (?, 'a', ?, ?, 0)";
            let collection = if name == "slow of another" { "c" } else { "b" };
            store.connection.execute(sql, params![name, collection, position]).unwrap();
        }
        for _ in 0..10 {
            let document = rawdoc! { "pad": "x".repeat(1_000) };
            append(&store.connection, &ns("b"), Noted::insert(&document, 1)).unwrap();
        }
        bound(&store.connection, 100_000, |_| Ok(())).unwrap();
        assert_eq!(numbers(&store, "SELECT sequence FROM changes").len(), 10);
        bound(&store.connection, 5_000, |_| Ok(())).unwrap();
        assert_eq!(numbers(&store, "SELECT sequence FROM changes"), [7, 8, 9, 10]);
        assert_eq!(numbers(&store, "SELECT missed FROM watchers ORDER BY id"), [1, 0, 0]);
        trim(&store.connection, &ns("b")).unwrap();
        assert_eq!(numbers(&store, "SELECT sequence FROM changes"), [10]);
        assert_eq!(last(&store.connection).unwrap(), 10);
    }
}
