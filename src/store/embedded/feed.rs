//! Following the change log: what a watcher has not seen, in order.

use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

use bson::{Bson, DateTime, RawDocumentBuf};
use rusqlite::params;

use super::notifier::Notifier;
use super::page::PageError;
use super::place::Place;
use super::watcher::{self, State, Taken, Watcher};
use super::{Embedded, change_log};
use crate::query::QueryError;
use crate::store::{Change, Changes, Name, Namespace, Next, StoreError};

/// At most so many changes are read at once …
const PAGE: usize = 256;
/// … or about so many bytes.
const PAGE_BYTES: usize = 1 << 20;
/// How often a watcher without a name says how far it is, and each says that it lives.
const PULSE: Duration = Duration::from_secs(15);
/// How long a position may wait to be written while others are writing all the time.
const DEFERRAL: Duration = Duration::from_secs(5);
/// After so many changes, a watcher without a name says how far it is.
const STRIDE: i64 = 1_000;

/// The changes of a collection for one watcher.
struct Feed<'a> {
    store: &'a Embedded,
    namespace: Namespace,
    name: Option<String>,
    /// What is written in the file of how far this is.
    noted: Watcher,
    /// The last change that was given.
    given: i64,
    /// The last change that is dealt with.
    settled: i64,
    /// Since when the position waits to be written.
    waiting: Option<Instant>,
    page: VecDeque<(i64, Change)>,
    notifier: Notifier,
    pulse: Instant,
    path: &'a Path,
    /// Which file it is, told by the system; the path may come to name another one.
    file: Option<(u64, u64)>,
}

impl Embedded {
    /// Follows the changes of a collection, by a name or until the process ends.
    pub(super) fn follow(&self, ns: &Namespace, name: Option<&str>) -> Result<Box<dyn Changes + '_>, StoreError> {
        let Place::File(path) = &self.place else {
            let reason = "nobody else can change a memory in this process, so there is nothing to watch; \
                          use file:PATH or mongodb://…";
            return Err(StoreError::Unfit { address: self.place.to_string(), reason: reason.to_owned() });
        };
        let notifier = Notifier::new(path);
        let noted = match self.write(|| watcher::take(&self.connection, ns, name).map_err(|e| self.explain(&e)))? {
            Taken::Mine(watcher) => watcher,
            other => return Err(refusal(&other, name.unwrap_or_default())),
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
            pulse: Instant::now(),
            path,
            file: identity(path),
        };
        feed.turn()?;
        Ok(Box::new(feed))
    }

    /// The names, and what is kept for each.
    pub(super) fn watch_names(&self) -> Result<Vec<Name>, StoreError> {
        watcher::names(&self.connection).map_err(|e| self.explain(&e))
    }

    /// Forgets how far a name is; says whether there was one.
    pub(super) fn forget_name(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        match self.write(|| watcher::forget(&self.connection, ns, name).map_err(|e| self.explain(&e)))? {
            None => Ok(false),
            Some(Taken::Mine(_)) => Ok(true),
            Some(other) => Err(refusal(&other, name)),
        }
    }
}

fn refusal(taken: &Taken, name: &str) -> StoreError {
    match taken {
        Taken::Other(ns) => StoreError::Held { what: format!("the name `{name}` follows {ns}; use another name") },
        Taken::Held(process) => {
            StoreError::Held { what: format!("process {process} follows changes by the name `{name}`; end it first") }
        }
        // What is one's own is not refused.
        Taken::Mine(_) => StoreError::Held { what: format!("the name `{name}` is in use") },
    }
}

/// Which file a path names.
fn identity(path: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt as _;
    std::fs::metadata(path).ok().map(|file| (file.dev(), file.ino()))
}

impl Feed<'_> {
    /// Reads the next page, and makes sure that nothing is missing before it.
    fn turn(&mut self) -> Result<(), StoreError> {
        let page = self.read().map_err(|trouble| match trouble {
            PageError::Store(error) => self.store.explain(&error),
            PageError::Query(error) => error.into(),
        })?;
        // The log may be cut at any moment: what is asked last is true of what was read first.
        match self.noted.state(&self.store.connection).map_err(|e| self.store.explain(&e))? {
            State::Good => {
                self.page = page;
                Ok(())
            }
            State::Missed => Err(self.missed()),
            State::Gone => {
                let what = format!("somebody else has taken over, or forgotten, this watch of {}", self.namespace);
                Err(StoreError::Held { what })
            }
        }
    }

    fn read(&self) -> Result<VecDeque<(i64, Change)>, PageError> {
        let sql = "SELECT sequence, kind, time, before, after FROM changes
                   WHERE database = ? AND collection = ? AND sequence > ? ORDER BY sequence";
        let mut statement = self.store.connection.prepare_cached(sql)?;
        let mut rows = statement.query(params![self.namespace.database, self.namespace.collection, self.given])?;
        let (mut page, mut bytes) = (VecDeque::new(), 0);
        while page.len() < PAGE && bytes < PAGE_BYTES {
            let Some(row) = rows.next()? else { break };
            let (sequence, change) = change(row)?;
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

    /// Writes down how far this is, and that the process lives. While others write all the
    /// time that is put off for a while, so that changes are given meanwhile.
    fn advance(&mut self) -> Result<(), StoreError> {
        let watcher = Watcher { position: self.settled, ..self.noted.clone() };
        let store = self.store;
        let work = || watcher.advance(&store.connection, &self.namespace).map_err(|e| store.explain(&e));
        let is_overdue = self.waiting.is_some_and(|since| since.elapsed() >= DEFERRAL);
        let written = if is_overdue { Some(store.write(work)?) } else { store.write_soon(work)? };
        if written.is_none() {
            self.waiting.get_or_insert_with(Instant::now);
            return Ok(());
        }
        (self.noted, self.waiting, self.pulse) = (watcher, None, Instant::now());
        Ok(())
    }

    /// A file that was removed, or replaced by another, is written by nobody any more.
    fn check_file(&self) -> Result<(), StoreError> {
        if identity(self.path) == self.file {
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
        let due = ahead > 0 && (self.name.is_some() || ahead >= STRIDE || self.pulse.elapsed() >= PULSE);
        if due { self.advance() } else { Ok(()) }
    }

    fn renew(&mut self) -> Result<(), StoreError> {
        if self.pulse.elapsed() < PULSE { Ok(()) } else { self.advance() }
    }
}

impl Drop for Feed<'_> {
    fn drop(&mut self) {
        let store = self.store;
        let named = self.name.is_some();
        self.noted.position = self.settled;
        // What cannot be released now is released by whoever finds this process gone.
        let _ = store
            .write(|| self.noted.release(&store.connection, &self.namespace, named).map_err(|e| store.explain(&e)));
    }
}

fn change(row: &rusqlite::Row<'_>) -> Result<(i64, Change), PageError> {
    let document = |column: &str| -> Result<Option<RawDocumentBuf>, PageError> {
        let bytes: Option<Vec<u8>> = row.get(column)?;
        Ok(bytes.map(RawDocumentBuf::from_bytes).transpose().map_err(QueryError::from)?)
    };
    let sequence: i64 = row.get("sequence")?;
    let (before, after) = (document("before")?, document("after")?);
    let id = match after.as_ref().or(before.as_ref()) {
        Some(document) => document.get("_id").map_err(QueryError::from)?.map(Bson::try_from).transpose(),
        None => Ok(None),
    };
    let kind: i64 = row.get("kind")?;
    let kind = change_log::kind(kind).ok_or_else(|| rusqlite::Error::IntegralValueOutOfRange(1, kind))?;
    let change = Change {
        kind,
        id: id.map_err(QueryError::from)?,
        before,
        after,
        time: DateTime::from_millis(row.get("time")?),
        position: sequence.to_string(),
    };
    Ok((sequence, change))
}
