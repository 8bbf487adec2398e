//! Keeping the history of collections, in the log of changes (`change_log`).
//!
//! A row of `watchers` keeps the changes of a scope, as it does for watches; the row of
//! `histories` says for how long and how much of them, and `origins` has the author of each change.
//! `cut_runs` has the runs of which changes are not kept any more.
//! Changes are noted in the transaction that makes them. The tables are made when a history is
//! first kept; where none is, a write does nothing for it.
//!
//! Every process that writes keeps the history, whatever its settings say, so that there are no
//! gaps. A scope that no process's settings have named for as long as its changes are kept is let go.

use std::cell::{Cell, RefCell};
use std::collections::HashSet;
use std::time::{Duration, Instant};

use bson::{DateTime, RawDocument};
use rusqlite::{Connection, OptionalExtension as _, params};

use super::change_log;
use super::watcher::{HISTORY as PREFIX, covers};
use crate::saturate::to_i64;
use crate::store::history::next_run;
use crate::store::{HistoryRule, Namespace, Scope};

/// How long, in milliseconds, a scope is kept at least after the last process named it.
const LEASE: i64 = 3_600_000;
/// How often a process that goes on writing names its scopes again: often within a [`LEASE`].
const RENEWAL_INTERVAL: Duration = Duration::from_secs(60);

const TABLES: &str = "
CREATE TABLE IF NOT EXISTS histories (
    database TEXT NOT NULL,
    collection TEXT NOT NULL,
    age INTEGER NOT NULL,
    size INTEGER NOT NULL,
    since INTEGER NOT NULL,
    beat INTEGER NOT NULL,
    PRIMARY KEY (database, collection)
) STRICT;
CREATE TABLE IF NOT EXISTS origins (
    sequence INTEGER PRIMARY KEY,
    author TEXT NOT NULL,
    run INTEGER NOT NULL,
    place INTEGER
) STRICT;
CREATE TABLE IF NOT EXISTS cut_runs (
    database TEXT NOT NULL,
    collection TEXT NOT NULL,
    run INTEGER NOT NULL,
    first INTEGER NOT NULL,
    last INTEGER NOT NULL,
    PRIMARY KEY (database, collection, run)
) STRICT;";

/// How many runs are remembered that have no changes left: they may go on.
const GONE_RUNS: i64 = 1_000;

/// The tables and their columns.
pub(super) const TABLES_WITH_COLUMNS: [(&str, &str); 3] = [
    ("histories", "database, collection, age, size, since, beat"),
    ("origins", "sequence, author, run, place"),
    ("cut_runs", "database, collection, run, first, last"),
];

/// Makes the tables where they are missing. In a write transaction only.
pub(super) fn prepare(connection: &Connection) -> rusqlite::Result<()> {
    connection.execute_batch(TABLES)
}

/// The histories that this process keeps, and how it signs.
#[derive(Default)]
pub(super) struct Keeping {
    pub(super) rules: RefCell<Vec<HistoryRule>>,
    pub(super) author: RefCell<String>,
    pub(super) run: Cell<i64>,
    renewed: Cell<Option<Instant>>,
}

/// The history of a scope, as the file has it.
#[derive(Debug, Clone)]
pub(super) struct Kept {
    /// The scope, with empty names for all.
    pub(super) pattern: Namespace,
    age: i64,
    pub(super) size: i64,
    /// All changes since then are there.
    pub(super) since: DateTime,
    /// All changes behind this position are there; none where the scope is left out.
    pub(super) position: Option<i64>,
}

impl Keeping {
    /// Sets the author of the changes that follow, as one run.
    pub(super) fn sign(&self, author: &str) {
        if *self.author.borrow() != author {
            author.clone_into(&mut self.author.borrow_mut());
        }
        self.run.set(next_run());
    }

    /// Whether the scopes are to be named again.
    fn is_due(&self) -> bool {
        !self.rules.borrow().is_empty() && self.renewed.get().is_none_or(|at| at.elapsed() >= RENEWAL_INTERVAL)
    }

    /// Names the scopes of this process in the file. In a write transaction only.
    pub(super) fn renew(&self, connection: &Connection) -> rusqlite::Result<()> {
        if !self.is_due() {
            return Ok(());
        }
        prepare(connection)?;
        for rule in self.rules.borrow().iter() {
            name(connection, rule)?;
        }
        self.renewed.set(Some(Instant::now()));
        Ok(())
    }

    /// To be called where a transaction that named the scopes was taken back.
    pub(super) fn forget(&self) {
        self.renewed.set(None);
    }
}

/// Writes the row of a rule. A new one takes over what a wider history has of its scope.
fn name(connection: &Connection, rule: &HistoryRule) -> rusqlite::Result<()> {
    let (pattern, now) = (pattern(&rule.scope), DateTime::now().timestamp_millis());
    let sql = "SELECT 1 FROM watchers WHERE name = ?";
    let is_kept = connection.prepare_cached(sql)?.exists([row_name(&pattern)])?;
    let former = if is_kept { None } else { wider(connection, &pattern)? };
    let age = to_i64(rule.age.as_millis());
    let size = to_i64(rule.size);
    let sql = "INSERT INTO histories (database, collection, age, size, since, beat) VALUES (?1, ?2, ?3, ?4, ?5, ?5)
               ON CONFLICT DO UPDATE SET age = ?3, size = ?4, beat = ?5";
    connection.prepare_cached(sql)?.execute(params![pattern.database, pattern.collection, age, size, now])?;
    if age == 0 {
        return release(connection, &pattern);
    }
    if is_kept {
        return Ok(());
    }
    let (position, since) = match former {
        Some(former) => former,
        None => (change_log::last(connection)?, now),
    };
    let sql = "INSERT INTO watchers (name, database, collection, position, beat) VALUES (?, ?, ?, ?, ?)";
    connection.execute(sql, params![row_name(&pattern), pattern.database, pattern.collection, position, now])?;
    let sql = "UPDATE histories SET since = ? WHERE database = ? AND collection = ?";
    connection.execute(sql, params![since, pattern.database, pattern.collection]).map(|_| ())
}

/// From which position and time on a wider history has the changes of a scope that has no row yet. One that has a
/// row may have been left out for a while.
fn wider(connection: &Connection, pattern: &Namespace) -> rusqlite::Result<Option<(i64, i64)>> {
    let all: Vec<Kept> = rows(connection)?.into_iter().map(|(kept, _)| kept).collect();
    if all.iter().any(|kept| kept.pattern == *pattern) {
        return Ok(None);
    }
    Ok(choose(&all, pattern).and_then(|kept| Some((kept.position?, kept.since.timestamp_millis()))))
}

/// Keeps the changes of a scope no longer.
fn release(connection: &Connection, pattern: &Namespace) -> rusqlite::Result<()> {
    let removed = connection.execute("DELETE FROM watchers WHERE name = ?", [row_name(pattern)])?;
    if removed == 0 { Ok(()) } else { clear(connection, pattern) }
}

/// Removes the changes of a scope that nothing keeps, and the authors of changes that are gone.
fn clear(connection: &Connection, pattern: &Namespace) -> rusqlite::Result<()> {
    change_log::trim(connection, pattern)?;
    let sql = "DELETE FROM origins WHERE sequence < coalesce((SELECT min(sequence) FROM changes), 9223372036854775807)";
    connection.prepare_cached(sql)?.execute([]).map(|_| ())
}

/// The histories that the file keeps, those that were not named for long removed. In a write transaction only.
pub(super) fn current(connection: &Connection) -> rusqlite::Result<Vec<Kept>> {
    let now = DateTime::now().timestamp_millis();
    let (live, lapsed): (Vec<_>, Vec<_>) =
        rows(connection)?.into_iter().partition(|(kept, beat)| now.saturating_sub(*beat) <= kept.age.max(LEASE));
    for (kept, _) in lapsed {
        let Namespace { database, collection } = &kept.pattern;
        connection.execute("DELETE FROM histories WHERE database = ? AND collection = ?", [database, collection])?;
        release(connection, &kept.pattern)?;
    }
    Ok(live.into_iter().map(|(kept, _)| kept).collect())
}

/// The histories that the file keeps. To be called only where there is a row in `watchers`.
fn rows(connection: &Connection) -> rusqlite::Result<Vec<(Kept, i64)>> {
    let sql = "SELECT histories.database, histories.collection, age, size, since, histories.beat, position
               FROM histories LEFT JOIN watchers ON name = ?1 || histories.database || '.' || histories.collection";
    let mut statement = connection.prepare_cached(sql)?;
    let rows = statement.query_map([PREFIX], |row| {
        let pattern = Namespace { database: row.get(0)?, collection: row.get(1)? };
        let since = DateTime::from_millis(row.get(4)?);
        Ok((Kept { pattern, age: row.get(2)?, size: row.get(3)?, since, position: row.get(6)? }, row.get(5)?))
    })?;
    rows.collect()
}

/// The history of a collection, where it is kept.
pub(super) fn of(connection: &Connection, ns: &Namespace) -> rusqlite::Result<Option<Kept>> {
    let sql = "SELECT 1 FROM watchers WHERE substr(name, 1, length(?1)) = ?1";
    if !connection.prepare_cached(sql)?.exists([PREFIX])? {
        return Ok(None);
    }
    let all: Vec<Kept> = rows(connection)?.into_iter().map(|(kept, _)| kept).collect();
    Ok(choose(&all, ns).cloned())
}

/// The history of a collection: that of the smallest scope.
pub(super) fn choose<'k>(all: &'k [Kept], ns: &Namespace) -> Option<&'k Kept> {
    let narrowness = |kept: &&Kept| (!kept.pattern.database.is_empty(), !kept.pattern.collection.is_empty());
    let fitting = all.iter().filter(|kept| covers(&kept.pattern, ns)).max_by_key(narrowness);
    fitting.filter(|kept| kept.position.is_some())
}

/// Notes the author of a change. In the transaction that appended it.
pub(super) fn sign(connection: &Connection, keeping: &Keeping, place: Option<i64>) -> rusqlite::Result<()> {
    let sql = "INSERT OR REPLACE INTO origins (sequence, author, run, place) VALUES (?, ?, ?, ?)";
    let sequence = connection.last_insert_rowid();
    let (author, run) = (&*keeping.author.borrow(), keeping.run.get());
    connection.prepare_cached(sql)?.execute(params![sequence, author, run, place]).map(|_| ())
}

/// Lets go of changes that are too old or too many. In a write transaction only.
pub(super) fn bound(connection: &Connection, kept: &[Kept]) -> rusqlite::Result<()> {
    for kept in kept {
        let Some(position) = kept.position else { continue };
        let Some(cut) = cut_of(connection, kept, position)? else { continue };
        advance(connection, &kept.pattern, cut)?;
        clear(connection, &kept.pattern)?;
    }
    Ok(())
}

/// The last change to let go of; none as long as little would be gained.
fn cut_of(connection: &Connection, kept: &Kept, position: i64) -> rusqlite::Result<Option<i64>> {
    let sql = "SELECT time, volume FROM changes WHERE sequence > ? ORDER BY sequence LIMIT 1";
    let row = |row: &rusqlite::Row<'_>| Ok((row.get::<_, i64>(0)?, row.get::<_, i64>(1)?));
    let first = connection.prepare_cached(sql)?.query_row([position], row).optional()?;
    let Some((time, volume)) = first else { return Ok(None) };
    let sql = "SELECT volume FROM changes ORDER BY sequence DESC LIMIT 1";
    let last: i64 = connection.prepare_cached(sql)?.query_row([], |row| row.get(0))?;
    let oldest = DateTime::now().timestamp_millis().saturating_sub(kept.age);
    let is_old = time < oldest.saturating_sub(kept.age / 16);
    if !is_old && last - volume <= kept.size {
        return Ok(None);
    }
    // The first change that stays: what is removed is removed a sixteenth, or a quarter, at once.
    let least = if last - volume > kept.size { last - kept.size / 4 * 3 } else { i64::MIN };
    let sql =
        "SELECT sequence - 1 FROM changes WHERE sequence > ? AND time >= ? AND volume >= ? ORDER BY sequence LIMIT 1";
    let cut = connection.prepare_cached(sql)?.query_row([position, oldest, least], |row| row.get(0)).optional()?;
    cut.map_or_else(|| change_log::last(connection), Ok).map(Some)
}

/// Moves a history on to a position.
fn advance(connection: &Connection, pattern: &Namespace, cut: i64) -> rusqlite::Result<()> {
    note_cut_runs(connection, pattern, cut)?;
    let sql = "UPDATE histories SET since = max(since, coalesce((
                   SELECT time FROM changes WHERE sequence <= ?1 ORDER BY sequence DESC LIMIT 1), since))
               WHERE database = ?2 AND collection = ?3";
    connection.execute(sql, params![cut, pattern.database, pattern.collection])?;
    connection.execute("UPDATE watchers SET position = ? WHERE name = ?", params![cut, row_name(pattern)]).map(|_| ())
}

/// Notes the runs whose changes go: for each collection, the first and the last of them.
fn note_cut_runs(connection: &Connection, pattern: &Namespace, cut: i64) -> rusqlite::Result<()> {
    if !has_cut_runs(connection)? {
        // An earlier rmem began this history.
        prepare(connection)?;
    }
    let sql = "INSERT INTO cut_runs (database, collection, run, first, last)
               SELECT database, collection, run, min(sequence), max(sequence) FROM changes JOIN origins USING (sequence)
               WHERE sequence > (SELECT position FROM watchers WHERE name = ?1) AND sequence <= ?2
               AND ?3 IN ('', database) AND ?4 IN ('', collection) GROUP BY database, collection, run
               ON CONFLICT DO UPDATE SET first = min(first, excluded.first), last = max(last, excluded.last)";
    connection.execute(sql, params![row_name(pattern), cut, pattern.database, pattern.collection])?;
    let sql = "DELETE FROM cut_runs WHERE run NOT IN (SELECT run FROM origins)
               AND last <= (SELECT last FROM cut_runs ORDER BY last DESC LIMIT 1 OFFSET ?)";
    connection.execute(sql, [GONE_RUNS]).map(|_| ())
}

fn has_cut_runs(connection: &Connection) -> rusqlite::Result<bool> {
    connection.prepare_cached("SELECT 1 FROM sqlite_schema WHERE name = 'cut_runs'")?.exists([])
}

/// The runs of which the history of a collection, kept behind a position, has not all changes.
pub(super) fn cut_runs(connection: &Connection, ns: &Namespace, position: i64) -> rusqlite::Result<HashSet<i64>> {
    if !has_cut_runs(connection)? {
        return Ok(HashSet::new());
    }
    let sql = "SELECT run FROM cut_runs WHERE database = ? AND collection = ? AND first <= ?";
    let mut statement = connection.prepare_cached(sql)?;
    statement.query_map(params![ns.database, ns.collection, position], |row| row.get(0))?.collect()
}

/// Moves all histories behind `last`, up to which changes are about to be removed.
pub(super) fn cut(connection: &Connection, kept: &[Kept], last: i64) -> rusqlite::Result<()> {
    let behind = |kept: &&Kept| kept.position.is_some_and(|position| position < last);
    kept.iter().filter(behind).try_for_each(|kept| advance(connection, &kept.pattern, last))
}

/// A scope as it is written in a row: with empty names for all.
fn pattern(scope: &Scope) -> Namespace {
    match scope {
        Scope::Collection(ns) => ns.clone(),
        Scope::Database(database) => Namespace { database: database.clone(), collection: String::new() },
        Scope::All => Namespace { database: String::new(), collection: String::new() },
    }
}

fn row_name(pattern: &Namespace) -> String {
    format!("{PREFIX}{}.{}", pattern.database, pattern.collection)
}

/// Whether a computable made a document: such documents are not part of the history.
pub(super) fn is_computed(document: Option<&RawDocument>) -> bool {
    document.is_some_and(|document| crate::store::metadata::is_computed(document).unwrap_or(false))
}
