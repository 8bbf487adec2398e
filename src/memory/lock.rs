//! Mutual exclusion between robots, through the memory.
//!
//! A mutex is a document `{_id: NAME, locked, "locked-by", "lock-time"}`, with
//! `lock-until` where the lock expires. Taking it is one conditional update,
//! which succeeds for one of the processes that try at the same time. Times are the
//! store's, not the robot's, so that robots whose clocks differ agree on what has
//! expired.

use std::time::{Duration, Instant};

use bson::{Bson, DateTime, Document, doc};

use super::Memory;
use crate::formats::visible;
use crate::query::QueryError;
use crate::saturate::to_i64;
use crate::store::{Find, FindAndModify, Modification, Modifiers, Namespace, StoreError, UpdateRequest, UpdateSpec};

/// How long a waiting process sleeps at first …
const MIN_BACKOFF: Duration = Duration::from_millis(5);
/// … and at most.
const MAX_BACKOFF: Duration = Duration::from_millis(250);

/// How much later than now a lock may have been taken without a note, in milliseconds: the clocks of machines differ.
const CLOCK_DIFFERENCE: i64 = 5_000;

/// A mutex, and the owner that asks for it.
#[derive(Debug, Clone)]
pub struct Mutex {
    /// The collection of mutexes.
    pub namespace: Namespace,
    /// Which one.
    pub name: String,
    /// The owner that locks it; the same owner may lock it again.
    pub owner: String,
}

/// The holder of a mutex.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holder {
    /// The owner.
    pub owner: String,
    /// Since when.
    pub since: Option<DateTime>,
    /// Until when, where the lock expires.
    pub until: Option<DateTime>,
}

/// The result of trying to lock or unlock.
#[derive(Debug, Clone, PartialEq)]
pub enum Tried {
    /// It is done; the document of the mutex.
    Done(Document),
    /// Another owner holds it.
    Held(Holder),
    /// It is not locked (when unlocking).
    Free,
}

impl Mutex {
    /// Tries to lock, once. The holder's lock is renewed; it expires after
    /// `ttl`, or never.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn try_lock(&self, memory: &Memory, ttl: Option<Duration>) -> Result<Tried, StoreError> {
        loop {
            if memory.update(&self.namespace, &self.taking(ttl))?.matched > 0 {
                return Ok(Tried::Done(self.read(memory)?.unwrap_or_default()));
            }
            if self.create(memory)? {
                continue;
            }
            match self.read(memory)? {
                Some(document) if document.get_bool("locked").unwrap_or(false) => {
                    return Ok(Tried::Held(Holder::of(&document)));
                }
                // The holder has just unlocked it.
                _ => std::thread::sleep(MIN_BACKOFF),
            }
        }
    }

    /// Locks, even if another owner holds the lock; returns that owner.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn force(&self, memory: &Memory, ttl: Option<Duration>) -> Result<(Option<Holder>, Document), StoreError> {
        self.create(memory)?;
        let taking = modification(doc! { "_id": &self.name }, self.taken(ttl));
        let before = modified(memory, &self.namespace, &taking)?.unwrap_or_default();
        let is_others =
            before.get_bool("locked").unwrap_or(false) && before.get_str("locked-by").ok() != Some(self.owner.as_str());
        Ok((is_others.then(|| Holder::of(&before)), self.read(memory)?.unwrap_or_default()))
    }

    /// Tries to lock until it is done or `timeout` is over.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn lock(&self, memory: &Memory, ttl: Option<Duration>, timeout: Duration) -> Result<Tried, StoreError> {
        let (start, mut pause) = (Instant::now(), MIN_BACKOFF);
        loop {
            let tried = self.try_lock(memory, ttl)?;
            let left = timeout.saturating_sub(start.elapsed());
            if left.is_zero() || !matches!(tried, Tried::Held(_)) {
                return Ok(tried);
            }
            std::thread::sleep(pause.min(left));
            pause = (pause * 2).min(MAX_BACKOFF);
        }
    }

    /// Unlocks the mutex if this owner holds it, expired or not.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn unlock(&self, memory: &Memory) -> Result<Tried, StoreError> {
        let filter = doc! { "_id": &self.name, "locked": true, "locked-by": &self.owner };
        if memory.update(&self.namespace, &request(filter, free(), false))?.matched > 0 {
            return Ok(Tried::Done(doc! { "_id": &self.name, "locked": false }));
        }
        Ok(match self.read(memory)? {
            Some(document) if document.get_bool("locked").unwrap_or(false) => Tried::Held(Holder::of(&document)),
            _ => Tried::Free,
        })
    }

    /// The update that takes the mutex where it is free, this owner's, or expired.
    fn taking(&self, ttl: Option<Duration>) -> UpdateRequest {
        let filter = doc! {
            "_id": &self.name,
            "$or": [{ "locked": { "$ne": true } }, { "locked-by": &self.owner }, expired()],
        };
        request(filter, self.taken(ttl), false)
    }

    /// How the mutex is when this owner holds it.
    fn taken(&self, ttl: Option<Duration>) -> UpdateSpec {
        let until = match ttl {
            Some(ttl) => {
                let milliseconds = to_i64(ttl.as_millis());
                Bson::Document(doc! { "$add": ["$$NOW", milliseconds] })
            }
            None => "$$REMOVE".into(),
        };
        let taken = doc! {
            "locked": true, "locked-by": { "$literal": &self.owner }, "lock-time": "$$NOW", "lock-until": until,
        };
        UpdateSpec::Pipeline(vec![doc! { "$set": taken }])
    }

    /// Creates the mutex where there is none; returns whether it did. Of several processes
    /// at the same time, one does.
    fn create(&self, memory: &Memory) -> Result<bool, StoreError> {
        let free = UpdateSpec::Document(doc! { "$setOnInsert": { "locked": false } });
        match memory.update(&self.namespace, &request(doc! { "_id": &self.name }, free, true)) {
            Ok(updated) => Ok(updated.upserted.is_some()),
            Err(StoreError::Duplicate { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }

    fn read(&self, memory: &Memory) -> Result<Option<Document>, StoreError> {
        let find = Find { filter: doc! { "_id": &self.name }, current: true, ..Find::default() };
        match memory.find(&self.namespace, &find)?.next() {
            Some(document) => Ok(Some(Document::try_from(&*document?).map_err(QueryError::from)?)),
            None => Ok(None),
        }
    }
}

impl Holder {
    fn of(document: &Document) -> Self {
        Self {
            owner: document.get_str("locked-by").unwrap_or("an unnamed owner").to_owned(),
            since: document.get_datetime("lock-time").ok().copied(),
            until: document.get_datetime("lock-until").ok().copied(),
        }
    }
}

impl std::fmt::Display for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "held by {}", visible::line(&self.owner))?;
        let text = |date: DateTime| date.try_to_rfc3339_string().unwrap_or_else(|_| date.to_string());
        if let Some(since) = self.since {
            write!(f, " since {}", text(since))?;
            if boot_time().is_some_and(|boot| since < boot) {
                write!(f, " (before this machine was started, or its clock was set)")?;
            } else if since.timestamp_millis() > DateTime::now().timestamp_millis().saturating_add(CLOCK_DIFFERENCE) {
                write!(f, " (in the future: this clock was set back, or another machine's is ahead)")?;
            }
        }
        match self.until {
            Some(until) => write!(f, " until {}", text(until)),
            None => write!(f, ", with no end"),
        }
    }
}

/// When this machine was started, by its clock now.
fn boot_time() -> Option<DateTime> {
    let stat = std::fs::read_to_string("/proc/stat").ok()?;
    let line = stat.lines().find_map(|line| line.strip_prefix("btime "))?;
    Some(DateTime::from_millis(line.trim().parse::<i64>().ok()?.checked_mul(1_000)?))
}

/// Releases the expired locks of a collection, or the one of that name if it has expired; returns them as they were.
///
/// # Errors
/// Where the store fails.
pub fn release_expired(
    memory: &Memory,
    namespace: &Namespace,
    name: Option<&str>,
) -> Result<Vec<(Bson, Holder)>, StoreError> {
    let mut filter = doc! { "locked": true, "$and": [expired()] };
    if let Some(name) = name {
        filter.insert("_id", name);
    }
    let releasing = FindAndModify { sort: doc! { "_id": 1 }, ..modification(filter, free()) };
    let mut released = Vec::new();
    // One after another, so that a lock that its owner renews meanwhile stays.
    while let Some(before) = modified(memory, namespace, &releasing)? {
        released.push((before.get("_id").cloned().unwrap_or(Bson::Null), Holder::of(&before)));
    }
    Ok(released)
}

/// The condition that a lock has expired, by the store's clock.
fn expired() -> Document {
    doc! { "lock-until": { "$type": "date" }, "$expr": { "$lte": ["$lock-until", "$$NOW"] } }
}

/// The fields of a mutex without a holder.
fn free() -> UpdateSpec {
    UpdateSpec::Document(
        doc! { "$set": { "locked": false }, "$unset": { "locked-by": 1, "lock-time": 1, "lock-until": 1 } },
    )
}

fn modification(filter: Document, update: UpdateSpec) -> FindAndModify {
    let modification = Modification::Update { update, array_filters: Vec::new(), upsert: false };
    FindAndModify {
        filter,
        sort: Document::new(),
        modification,
        new: false,
        projection: Document::new(),
        modifiers: Modifiers::default(),
    }
}

/// The mutex that was changed, as it was.
fn modified(memory: &Memory, namespace: &Namespace, change: &FindAndModify) -> Result<Option<Document>, StoreError> {
    let found = memory.find_and_modify(namespace, change)?.document;
    Ok(found.map(|raw| Document::try_from(&*raw)).transpose().map_err(QueryError::from)?)
}

fn request(filter: Document, update: UpdateSpec, upsert: bool) -> UpdateRequest {
    UpdateRequest { filter, update, upsert, ..UpdateRequest::default() }
}
