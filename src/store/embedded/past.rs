//! Reading the history of collections (`history`): its entries, and a collection as it was.

use std::collections::{BTreeMap, HashSet, VecDeque};

use bson::{DateTime, Document, RawDocument, RawDocumentBuf};
use rusqlite::{Connection, OptionalExtension as _, params};

use super::feed::{self, Logged};
use super::history::{self, Kept};
use super::page::PageError;
use super::snapshot::Snapshot;
use super::{Embedded, body, change_log};
use crate::query::{Collation, key};
use crate::store::history::{not_kept, too_old};
use crate::store::{ChangeKind, Entry, History, Namespace, StoreError};

/// How many entries are read at once.
const PAGE: i64 = 256;

/// The entries of a collection, read a page at a time.
struct Entries<'a> {
    store: &'a Embedded,
    namespace: Namespace,
    /// The last change that was read.
    behind: i64,
    page: VecDeque<(Entry, Option<i64>)>,
    is_over: bool,
}

impl Embedded {
    /// The history of a collection; nothing where none is kept.
    pub(super) fn past(&self, ns: &Namespace, after: Option<DateTime>) -> Result<Option<History<'_>>, StoreError> {
        let Some(kept) = history::of(&self.connection, ns).map_err(|e| self.explain(&e))? else { return Ok(None) };
        let behind = self.behind(ns, &kept, after)?;
        let cut_runs = history::cut_runs(&self.connection, ns, kept.position.unwrap_or_default());
        let cut_runs = cut_runs.map_err(|e| self.explain(&e))?;
        let entries = Entries { store: self, namespace: ns.clone(), behind, page: VecDeque::new(), is_over: false };
        let entries = Box::new(entries.map(|entry| entry.map(|(entry, _)| entry)));
        Ok(Some(History { since: kept.since, cut_runs, entries }))
    }

    /// The position behind which the changes after a time are.
    fn behind(&self, ns: &Namespace, kept: &Kept, after: Option<DateTime>) -> Result<i64, StoreError> {
        let position = kept.position.unwrap_or_default();
        let Some(after) = after else { return Ok(position) };
        // Where the clock was set back, what was changed before then was changed before what came next, whatever its time.
        let sql =
            "SELECT sequence FROM changes WHERE database = ?1 AND collection = ?2 AND sequence > ?3 AND time <= ?4
                   ORDER BY sequence DESC LIMIT 1";
        let ask = |connection: &Connection| {
            let values = params![ns.database, ns.collection, position, after.timestamp_millis()];
            let last = connection.prepare_cached(sql)?.query_row(values, |row| row.get(0)).optional()?;
            rusqlite::Result::Ok(last.unwrap_or(position))
        };
        ask(&self.connection).map_err(|e| self.explain(&e))
    }

    /// Since when all changes of a history are there. By a clock that was ahead and was set back, that is not over yet;
    /// then it is the time of the first change that was made after.
    fn beginning(&self, kept: &Kept) -> rusqlite::Result<DateTime> {
        if kept.since <= DateTime::now() {
            return Ok(kept.since);
        }
        let sql = "SELECT min(time) FROM changes WHERE sequence > ?";
        let position = kept.position.unwrap_or_default();
        let first: Option<i64> = self.connection.prepare_cached(sql)?.query_row([position], |row| row.get(0))?;
        Ok(first.map_or(kept.since, |first| kept.since.min(DateTime::from_millis(first))))
    }

    /// The documents of a collection as they were, without those of computables.
    pub(super) fn rewound(&self, ns: &Namespace, at: DateTime) -> Result<Vec<RawDocumentBuf>, StoreError> {
        let _snapshot = Snapshot::begin(&self.connection).map_err(|e| self.explain(&e))?;
        let kept = history::of(&self.connection, ns)
            .map_err(|e| self.explain(&e))?
            .ok_or_else(|| not_kept(ns, &self.log.keeping.rules.borrow()))?;
        let since = self.beginning(&kept).map_err(|e| self.explain(&e))?;
        if at < since {
            return Err(too_old(ns, at, since));
        }
        let behind = self.behind(ns, &kept, Some(at))?;
        let entries = Entries { store: self, namespace: ns.clone(), behind, page: VecDeque::new(), is_over: false };
        let (mut changed, mut documents) = (HashSet::new(), BTreeMap::new());
        for entry in entries {
            let (Entry { change, dropped, .. }, place) = entry?;
            if change.kind == ChangeKind::Drop && dropped {
                return Err(too_old(ns, at, change.time));
            }
            // The first change of a document since then has it as it was.
            let known = change.before.as_ref().or(change.after.as_ref());
            let Some(id) = known.map(|document| id_key(document)).transpose()? else { continue };
            if changed.insert(id)
                && let Some(before) = change.before
            {
                documents.insert((place.unwrap_or(i64::MAX), documents.len()), before);
            }
        }
        self.add_unchanged(ns, &changed, &mut documents)?;
        Ok(documents.into_values().collect())
    }

    /// Adds the documents that were not changed since.
    fn add_unchanged(
        &self,
        ns: &Namespace,
        changed: &HashSet<Vec<u8>>,
        documents: &mut BTreeMap<(i64, usize), RawDocumentBuf>,
    ) -> Result<(), StoreError> {
        let Some(collection) = self.collection(ns)? else { return Ok(()) };
        let sql = format!("SELECT position, key, body FROM {} ORDER BY position", collection.table());
        let mut statement = self.connection.prepare(&sql).map_err(|e| self.explain(&e))?;
        let mut rows = statement.query([]).map_err(|e| self.explain(&e))?;
        while let Some(row) = rows.next().map_err(|e| self.explain(&e))? {
            let read = || -> rusqlite::Result<(i64, Vec<u8>, Vec<u8>)> { Ok((row.get(0)?, row.get(1)?, row.get(2)?)) };
            let (position, key, stored) = read().map_err(|e| self.explain(&e))?;
            if changed.contains(&key) {
                continue;
            }
            let document = self.opened(collection, &stored)?;
            if !history::is_computed(Some(&document)) {
                documents.insert((position, documents.len()), document);
            }
        }
        Ok(())
    }

    /// The collections that have changes in the log, sorted.
    pub(super) fn list_changed(&self) -> Result<Vec<Namespace>, StoreError> {
        let read = || -> rusqlite::Result<Vec<Namespace>> {
            let sql = "SELECT DISTINCT database, collection FROM changes ORDER BY database, collection";
            let mut statement = self.connection.prepare_cached(sql)?;
            let rows =
                statement.query_map([], |row| Ok(Namespace { database: row.get(0)?, collection: row.get(1)? }))?;
            rows.collect()
        };
        read().map_err(|e| self.explain(&e))
    }
}

fn id_key(document: &RawDocument) -> Result<Vec<u8>, StoreError> {
    let id = document.get("_id").map_err(crate::query::QueryError::from)?;
    Ok(id.map(key::encode).unwrap_or_default())
}

impl Entries<'_> {
    fn read(&mut self) -> Result<(), StoreError> {
        let page = page(&self.store.connection, &self.namespace, self.behind);
        let page = page.map_err(|error| self.store.explain_page(&self.namespace, error))?;
        match page.last() {
            Some((sequence, ..)) => self.behind = *sequence,
            None => self.is_over = true,
        }
        self.page = page.into_iter().map(|(_, entry, place)| (entry, place)).collect();
        Ok(())
    }
}

impl Iterator for Entries<'_> {
    type Item = Result<(Entry, Option<i64>), StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.page.is_empty()
            && !self.is_over
            && let Err(error) = self.read()
        {
            self.is_over = true;
            return Some(Err(error));
        }
        self.page.pop_front().map(Ok)
    }
}

/// The collation that a dropped collection had.
fn collation(row: &rusqlite::Row<'_>) -> rusqlite::Result<Option<Collation>> {
    let stored: Option<Vec<u8>> = row.get("before")?;
    let definition = stored.and_then(|stored| Document::try_from(body::open(&stored).ok()?).ok());
    Ok(definition.and_then(|definition| Collation::parse(&definition).ok()))
}

/// An entry with its number, and the place of its document.
type Row = (i64, Entry, Option<i64>);

/// Reads some entries behind a position; none where there are no more.
fn page(connection: &Connection, ns: &Namespace, mut behind: i64) -> Result<Vec<Row>, PageError> {
    let sql = "SELECT changes.sequence AS sequence, kind, time, before, after, author, run, place
               FROM changes LEFT JOIN origins USING (sequence)
               WHERE database = ? AND collection = ? AND changes.sequence > ? ORDER BY changes.sequence LIMIT ?";
    let mut statement = connection.prepare_cached(sql)?;
    loop {
        let (mut page, start) = (Vec::new(), behind);
        let mut rows = statement.query(params![ns.database, ns.collection, behind, PAGE])?;
        while let Some(row) = rows.next()? {
            let Logged { sequence, change, .. } = feed::logged(row)?;
            behind = sequence;
            // The changes of computables are for watches.
            if !history::is_computed(change.after.as_deref().or(change.before.as_deref())) {
                let dropped = change_log::is_of_history(row.get("kind")?);
                let (author, run) = (row.get("author")?, row.get("run")?);
                let collation = if change.kind == ChangeKind::Drop { collation(row)? } else { None };
                let entry = Entry { change, dropped, author, run, collation };
                page.push((sequence, entry, row.get("place")?));
            }
        }
        if !page.is_empty() || behind == start {
            return Ok(page);
        }
    }
}
