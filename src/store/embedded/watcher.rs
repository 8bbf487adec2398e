//! The table of watchers. A row keeps changes in the log until its watcher is done with them.
//!
//! A watcher with a name stays when its process has ended; one without a name is removed.

use bson::DateTime;
use rusqlite::{Connection, OptionalExtension as _, params};

use super::change_log;
use crate::process::holder::{Holder, Life};
use crate::store::Namespace;
use crate::store::watch::{Name, Waiting};

/// How long, in milliseconds, a process of another container counts as running after its last heartbeat.
const UNSEEN_TIMEOUT: i64 = 60_000;

/// What the names of rows begin with that keep a history (`history`).
pub(super) const HISTORY: &str = "rmem.history:";

/// A watcher that is being followed by this process.
#[derive(Clone)]
pub(super) struct Watcher {
    pub(super) id: i64,
    /// This process, as its row names it.
    pub(super) holder: String,
    /// The last change it is done with.
    pub(super) position: i64,
}

/// The result of taking a name.
pub(super) enum Taken {
    /// It belongs to this process.
    Mine(Watcher),
    /// Another process follows it.
    Held(Holder),
    /// It belongs to another collection.
    Other(Namespace),
}

/// The state of a watcher.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum State {
    /// It belongs to this process, and no change was lost.
    Good,
    /// Changes that it had not taken were removed.
    Missed,
    /// It was removed, or another process has taken it.
    Gone,
}

struct Row {
    id: i64,
    namespace: Namespace,
    position: i64,
    holder: Option<String>,
    beat: i64,
}

impl Row {
    /// The running process that follows the watcher, if any.
    fn holder(&self) -> Option<Holder> {
        let holder: Holder = self.holder.as_ref()?.parse().ok()?;
        let is_alive = match holder.life() {
            Life::Running => true,
            // All processes that use a file run on one kernel.
            Life::Over | Life::Elsewhere => false,
            Life::Unseen => now() - self.beat < UNSEEN_TIMEOUT,
        };
        is_alive.then_some(holder)
    }
}

fn now() -> i64 {
    DateTime::now().timestamp_millis()
}

fn row(row: &rusqlite::Row<'_>) -> rusqlite::Result<Row> {
    let namespace = Namespace { database: row.get(1)?, collection: row.get(2)? };
    Ok(Row { id: row.get(0)?, namespace, position: row.get(3)?, holder: row.get(4)?, beat: row.get(5)? })
}

/// Whom changes are noted for.
#[derive(Default)]
pub(super) struct Audience {
    /// The watched collections.
    pub(super) watches: Vec<Namespace>,
    /// What changes are kept of for change streams, with empty names for all.
    pub(super) streams: Vec<Namespace>,
    /// Whether there are rows of histories.
    pub(super) has_histories: bool,
}

/// Whom changes are noted for. Removes watchers without a name whose process has ended. In a write transaction only.
pub(super) fn audience(connection: &Connection) -> rusqlite::Result<Audience> {
    let sql = "SELECT id, database, collection, position, holder, beat, name FROM watchers WHERE missed = 0";
    let mut statement = connection.prepare_cached(sql)?;
    let rows: Vec<(Row, Option<String>)> =
        statement.query_map([], |found| Ok((row(found)?, found.get(6)?)))?.collect::<Result<_, _>>()?;
    let (mut audience, mut left) = (Audience::default(), Vec::new());
    for (row, name) in rows {
        let is_named = |prefix: &str| name.as_ref().is_some_and(|name| name.starts_with(prefix));
        if is_named(HISTORY) {
            audience.has_histories = true;
        } else if is_named(change_log::PREFIX) {
            audience.streams.push(row.namespace);
        } else if name.is_none() && row.holder().is_none() {
            connection.execute("DELETE FROM watchers WHERE id = ?", [row.id])?;
            left.push(row.namespace);
        } else if !audience.watches.contains(&row.namespace) {
            audience.watches.push(row.namespace);
        }
    }
    left.iter().try_for_each(|ns| change_log::trim(connection, ns))?;
    Ok(audience)
}

/// Whether what is watched of a pattern (a collection, or with empty names a database or
/// everything) is a collection. What rmem keeps for itself is watched by its own name only.
pub(super) fn covers(pattern: &Namespace, ns: &Namespace) -> bool {
    let in_database = pattern.database.is_empty() || pattern.database == ns.database;
    pattern == ns || (pattern.collection.is_empty() && in_database && !ns.is_own())
}

/// Adds a watcher, or takes over an existing name. In a write transaction only.
pub(super) fn take(connection: &Connection, ns: &Namespace, name: Option<&str>) -> rusqlite::Result<Taken> {
    // Watchers of ended processes keep no changes.
    audience(connection)?;
    let myself = Holder::myself().to_string();
    if let Some(found) = name.map(|name| find(connection, name)).transpose()?.flatten() {
        if found.namespace != *ns {
            return Ok(Taken::Other(found.namespace));
        }
        if let Some(holder) = found.holder() {
            return Ok(Taken::Held(holder));
        }
        let sql = "UPDATE watchers SET holder = ?, beat = ? WHERE id = ?";
        connection.execute(sql, params![myself, now(), found.id])?;
        return Ok(Taken::Mine(Watcher { id: found.id, holder: myself, position: found.position }));
    }
    let position = change_log::last(connection)?;
    connection.execute(
        "INSERT INTO watchers (name, database, collection, position, holder, beat) VALUES (?, ?, ?, ?, ?, ?)",
        params![name, ns.database, ns.collection, position, myself, now()],
    )?;
    Ok(Taken::Mine(Watcher { id: connection.last_insert_rowid(), holder: myself, position }))
}

fn find(connection: &Connection, name: &str) -> rusqlite::Result<Option<Row>> {
    let sql = "SELECT id, database, collection, position, holder, beat FROM watchers WHERE name = ?";
    connection.prepare_cached(sql)?.query_row([name], row).optional()
}

/// Returns the names, with the changes kept for each.
pub(super) fn names(connection: &Connection) -> rusqlite::Result<Vec<Name>> {
    let sql = "SELECT id, database, collection, position, holder, beat, name, missed,
                   (SELECT count(*) FROM changes WHERE database = watchers.database
                        AND collection = watchers.collection AND sequence > watchers.position AND kind <> 5),
                   (SELECT total(coalesce(length(before), 0) + coalesce(length(after), 0)) FROM changes
                        WHERE database = watchers.database AND collection = watchers.collection
                          AND sequence > watchers.position AND kind <> 5)
               FROM watchers WHERE name IS NOT NULL AND substr(name, 1, length(?1)) <> ?1
                   AND substr(name, 1, length(?2)) <> ?2 ORDER BY database, collection, name";
    let mut statement = connection.prepare(sql)?;
    let names = statement.query_map([change_log::PREFIX, HISTORY], |found| {
        let watcher = row(found)?;
        let (changes, bytes): (i64, f64) = (found.get(8)?, found.get(9)?);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a sum of lengths")]
        let waiting = Waiting { changes: u64::try_from(changes).unwrap_or_default(), bytes: bytes as u64 };
        Ok(Name {
            name: found.get(6)?,
            process: watcher.holder().map(|holder| holder.process()),
            namespace: watcher.namespace,
            missed: found.get(7)?,
            waiting: Some(waiting),
        })
    })?;
    names.collect()
}

/// Forgets a name. In a write transaction only.
pub(super) fn forget(connection: &Connection, ns: &Namespace, name: &str) -> rusqlite::Result<Option<Taken>> {
    let Some(found) = find(connection, name)? else { return Ok(None) };
    if found.namespace != *ns {
        return Ok(Some(Taken::Other(found.namespace)));
    }
    if let Some(holder) = found.holder() {
        return Ok(Some(Taken::Held(holder)));
    }
    remove(connection, ns, found.id)?;
    let holder = Holder::myself().to_string();
    Ok(Some(Taken::Mine(Watcher { id: found.id, holder, position: found.position })))
}

impl Watcher {
    pub(super) fn state(&self, connection: &Connection) -> rusqlite::Result<State> {
        let sql = "SELECT missed, holder FROM watchers WHERE id = ?";
        let found: Option<(bool, Option<String>)> =
            connection.prepare_cached(sql)?.query_row([self.id], |row| Ok((row.get(0)?, row.get(1)?))).optional()?;
        Ok(match found {
            Some((_, holder)) if holder.as_deref() != Some(&self.holder) => State::Gone,
            Some((true, _)) => State::Missed,
            Some((false, _)) => State::Good,
            None => State::Gone,
        })
    }

    /// Records that the process is running, and its position. In a write transaction only.
    pub(super) fn advance(&self, connection: &Connection, ns: &Namespace) -> rusqlite::Result<()> {
        let sql = "UPDATE watchers SET position = ?, beat = ? WHERE id = ?";
        connection.prepare_cached(sql)?.execute([self.position, now(), self.id])?;
        change_log::trim(connection, ns)
    }

    /// Releases the watcher: a name stays for the next process that takes it. In a write transaction only.
    pub(super) fn release(&self, connection: &Connection, ns: &Namespace, named: bool) -> rusqlite::Result<()> {
        if !named {
            return remove(connection, ns, self.id);
        }
        let sql = "UPDATE watchers SET holder = NULL, position = ? WHERE id = ? AND holder = ?";
        connection.execute(sql, params![self.position, self.id, self.holder])?;
        change_log::trim(connection, ns)
    }
}

fn remove(connection: &Connection, ns: &Namespace, id: i64) -> rusqlite::Result<()> {
    connection.execute("DELETE FROM watchers WHERE id = ?", [id])?;
    change_log::trim(connection, ns)
}
