//! Delivering the changes that a watcher has not taken yet, in order.

use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

use bson::{Bson, DateTime, RawDocumentBuf};
use rusqlite::params;
use rusqlite::types::ValueRef;

use super::notifier::Notifier;
use super::page::PageError;
use super::place::Place;
use super::watcher::{self, State, Taken, Watcher};
use super::{Embedded, body, change_log};
use crate::query::QueryError;
use crate::store::{Change, ChangeKind, Changes, FileIdentity, Name, Namespace, Next, StoreError};

/// At most so many changes are read at once …
const PAGE: usize = 256;
/// … or about so many bytes.
const PAGE_BYTES: usize = 1 << 20;
/// How often a watcher records that its process is running, and one without a name its position.
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(15);
/// How long the position may stay unwritten while other processes write all the time.
const MAX_DEFERRAL: Duration = Duration::from_secs(5);
/// After this many changes, a watcher without a name records its position.
const STRIDE: i64 = 1_000;

/// The changes of a collection for one watcher.
struct Feed<'a> {
    store: &'a Embedded,
    namespace: Namespace,
    name: Option<String>,
    /// The watcher as it is recorded in the file.
    noted: Watcher,
    /// The last change that was delivered.
    given: i64,
    /// The last change that the application is done with.
    settled: i64,
    /// Since when the position is to be written.
    waiting: Option<Instant>,
    page: VecDeque<(i64, Change)>,
    notifier: Notifier,
    heartbeat: Instant,
    path: &'a Path,
    /// The file that is watched: the path may come to name another one.
    file: Option<FileIdentity>,
}

impl Embedded {
    pub(super) fn explain_page(&self, ns: &Namespace, error: PageError) -> StoreError {
        match error {
            PageError::Store(error) => self.explain(&error),
            PageError::Query(error) => error.into(),
            PageError::Damaged(damage, id) => {
                let of = id.map_or_else(|| ns.to_string(), |id| format!("the document with _id {id} of {ns}"));
                self.fail(&format!(
                    "a change of {of} in the log is damaged: {}; list all damage with `rmem doctor --deep`, and copy what can \
                     be read into a new file with `rmem repair -o FILE`",
                    damage.describe()
                ))
            }
        }
    }

    /// Follows the changes of a collection, by a name or until the process ends.
    pub(super) fn follow(&self, ns: &Namespace, name: Option<&str>) -> Result<Box<dyn Changes + '_>, StoreError> {
        let Place::File(path) = &self.place else {
            let reason = "no other process can change a memory in this process, so there is nothing to watch; \
                          use file:PATH or mongodb://…";
            return Err(StoreError::Unfit { address: self.place.to_string(), reason: reason.to_owned() });
        };
        let notifier = Notifier::new(path);
        let noted = loop {
            match self.write(|| watcher::take(&self.connection, ns, name).map_err(|e| self.explain(&e)))? {
                Taken::Mine(watcher) => break watcher,
                Taken::Held(holder) if holder.ends() => {}
                other => return Err(refusal(&other, name.unwrap_or_default())),
            }
        };
        let mut feed = Feed {
            store: self,
            namespace: ns.clone(),
            name: name.map(str::to_owned),
            given: noted.position,
            settled: noted.position,
            waiting: None,
            noted,
            page: VecDeque::new(),
            notifier,
            heartbeat: Instant::now(),
            path,
            file: FileIdentity::at(path).ok(),
        };
        feed.turn()?;
        Ok(Box::new(feed))
    }

    /// Returns the names, with the changes kept for each.
    pub(super) fn watch_names(&self) -> Result<Vec<Name>, StoreError> {
        watcher::names(&self.connection).map_err(|e| self.explain(&e))
    }

    /// Removes a name with its position; returns whether it existed.
    pub(super) fn forget_name(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        loop {
            match self.write(|| watcher::forget(&self.connection, ns, name).map_err(|e| self.explain(&e)))? {
                None => return Ok(false),
                Some(Taken::Mine(_)) => return Ok(true),
                Some(Taken::Held(holder)) if holder.ends() => {}
                Some(other) => return Err(refusal(&other, name)),
            }
        }
    }
}

fn refusal(taken: &Taken, name: &str) -> StoreError {
    match taken {
        Taken::Other(ns) => StoreError::Held { what: format!("the name `{name}` follows {ns}; use another name") },
        Taken::Held(holder) => {
            let process = holder.process();
            StoreError::Held { what: format!("process {process} follows changes by the name `{name}`; end it first") }
        }
        // Not reached: a watcher of this process is not refused.
        Taken::Mine(_) => StoreError::Held { what: format!("the name `{name}` is in use") },
    }
}

impl Feed<'_> {
    /// Reads the next page, and checks that no change before it was lost.
    fn turn(&mut self) -> Result<(), StoreError> {
        let page = self.read().map_err(|error| self.store.explain_page(&self.namespace, error))?;
        // The log may be shortened at any moment, so the state is read after the page.
        match self.noted.state(&self.store.connection).map_err(|e| self.store.explain(&e))? {
            State::Good => {
                self.page = page;
                Ok(())
            }
            State::Missed => Err(self.missed()),
            State::Gone => {
                let what = format!("another process has taken over, or removed, this watch of {}", self.namespace);
                Err(StoreError::Held { what })
            }
        }
    }

    fn read(&self) -> Result<VecDeque<(i64, Change)>, PageError> {
        let sql = "SELECT sequence, kind, time, before, after FROM changes
                   WHERE database = ? AND collection = ? AND sequence > ? AND kind <> 5 ORDER BY sequence";
        let mut statement = self.store.connection.prepare_cached(sql)?;
        let mut rows = statement.query(params![self.namespace.database, self.namespace.collection, self.given])?;
        let (mut page, mut bytes) = (VecDeque::new(), 0);
        while page.len() < PAGE && bytes < PAGE_BYTES {
            let Some(row) = rows.next()? else { break };
            let Logged { sequence, change, .. } = logged(row)?;
            bytes +=
                [&change.before, &change.after].into_iter().flatten().map(|raw| raw.as_bytes().len()).sum::<usize>();
            page.push_back((sequence, change));
        }
        Ok(page)
    }

    fn missed(&self) -> StoreError {
        let most = change_log::LARGEST >> 20;
        let reason = match &self.name {
            Some(name) => format!(
                "more than {most} MiB of changes were made since `{name}` followed {ns} last, and the oldest of them \
                 are gone; read {ns} anew, and forget the name with `rmem watch {ns} --resume {name} --forget`",
                ns = self.namespace
            ),
            None => format!(
                "more than {most} MiB of changes of {ns} were waiting to be taken, and the oldest of them are gone; \
                 read {ns} anew and watch again",
                ns = self.namespace
            ),
        };
        StoreError::Failed { address: self.store.place.to_string(), reason }
    }

    /// Records the position, and that the process is running. While other processes write all
    /// the time, this is deferred for up to [`MAX_DEFERRAL`], so that changes are still delivered.
    fn advance(&mut self) -> Result<(), StoreError> {
        let watcher = Watcher { position: self.settled, ..self.noted.clone() };
        let store = self.store;
        let work = || watcher.advance(&store.connection, &self.namespace).map_err(|e| store.explain(&e));
        let is_overdue = self.waiting.is_some_and(|since| since.elapsed() >= MAX_DEFERRAL);
        let written = if is_overdue { Some(store.write(work)?) } else { store.write_soon(work)? };
        if written.is_none() {
            self.waiting.get_or_insert_with(Instant::now);
            return Ok(());
        }
        (self.noted, self.waiting, self.heartbeat) = (watcher, None, Instant::now());
        Ok(())
    }

    /// Refuses to go on where the file was removed or replaced: no process writes to it any more.
    fn check_file(&self) -> Result<(), StoreError> {
        if FileIdentity::at(self.path).ok() == self.file {
            return Ok(());
        }
        let reason = "the file was removed or replaced while it was watched; watch again".to_owned();
        Err(StoreError::Failed { address: self.store.place.to_string(), reason })
    }
}

impl Changes for Feed<'_> {
    fn next(&mut self, timeout: Duration) -> Result<Next, StoreError> {
        let start = Instant::now();
        loop {
            if let Some((sequence, change)) = self.page.pop_front() {
                self.given = sequence;
                return Ok(Next::Change(Box::new(change)));
            }
            self.turn()?;
            if !self.page.is_empty() {
                continue;
            }
            let left = timeout.saturating_sub(start.elapsed());
            if left.is_zero() {
                self.check_file()?;
                self.renew()?;
                return Ok(Next::Nothing);
            }
            self.notifier.wait(left);
        }
    }

    fn done(&mut self) -> Result<(), StoreError> {
        self.settled = self.given;
        let ahead = self.settled - self.noted.position;
        let due =
            ahead > 0 && (self.name.is_some() || ahead >= STRIDE || self.heartbeat.elapsed() >= HEARTBEAT_INTERVAL);
        if due { self.advance() } else { Ok(()) }
    }

    fn renew(&mut self) -> Result<(), StoreError> {
        if self.heartbeat.elapsed() < HEARTBEAT_INTERVAL { Ok(()) } else { self.advance() }
    }
}

impl Drop for Feed<'_> {
    fn drop(&mut self) {
        let store = self.store;
        let named = self.name.is_some();
        self.noted.position = self.settled;
        // If it cannot be released now, the next process that finds this one ended releases it.
        let _ = store
            .write(|| self.noted.release(&store.connection, &self.namespace, named).map_err(|e| store.explain(&e)));
    }
}

/// A row of the log.
pub(super) struct Logged {
    pub(super) sequence: i64,
    pub(super) change: Change,
    /// Whether it is a drop by a rename, of which streams are told.
    pub(super) is_of_rename: bool,
}

/// Reads a row of the log.
pub(super) fn logged(row: &rusqlite::Row<'_>) -> Result<Logged, PageError> {
    let document = |column: &str| -> Result<Option<RawDocumentBuf>, PageError> {
        let stored = row.get_ref(column)?;
        if stored == ValueRef::Null {
            Ok(None)
        } else {
            body::of_column(stored).map(|document| Some(document.to_owned()))
        }
    };
    let sequence: i64 = row.get("sequence")?;
    let (before, after) = (document("before")?, document("after")?);
    let id = match after.as_ref().or(before.as_ref()) {
        Some(document) => document.get("_id").map_err(QueryError::from)?.map(Bson::try_from).transpose(),
        None => Ok(None),
    };
    let kind: i64 = row.get("kind")?;
    let kind = change_log::kind(kind).ok_or_else(|| rusqlite::Error::IntegralValueOutOfRange(1, kind))?;
    // A drop has no documents there, but the collation of the collection and the names of a rename.
    let is_of_rename = kind == ChangeKind::Drop && after.is_some();
    let (before, after) = if kind == ChangeKind::Drop { (None, None) } else { (before, after) };
    let change = Change {
        kind,
        id: id.map_err(QueryError::from)?,
        before,
        after,
        time: DateTime::from_millis(row.get("time")?),
        position: sequence.to_string(),
    };
    Ok(Logged { sequence, change, is_of_rename })
}
