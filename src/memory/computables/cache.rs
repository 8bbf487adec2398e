//! The cache: what was computed for which query, and until when it is good.
//!
//! It is a collection of the database whose documents are computed, so that all
//! processes share it: an entry for each computable and query. A process that
//! computes claims the entry first, by one conditional update; others wait. A claim
//! lasts no longer than the computation may. Each computation has a token,
//! which its documents bear; the entry names the token that counts. So an
//! answer is made of the documents of one computation, or is made again.

use bson::oid::ObjectId;
use bson::{Bson, DateTime, Document, doc};
use std::borrow::Cow;
use std::cell::Cell;
use std::time::Duration;

use super::definition::Definition;
use crate::process::holder::{Holder, Life};
use crate::query::{QueryError, decode};
use crate::saturate::to_i64;
use crate::store::{Find, Namespace, Store, StoreError, UpdateRequest, UpdateSpec, metadata};

/// The collection of the entries.
const COLLECTION: &str = "rmem.computed";
/// More documents of a computation are found by their token.
const MOST_IDS: usize = 10_000;
/// At most so many entries are cleaned up at once.
const SWEEP: u64 = 16;

/// A computation that took no longer is repeated within the transaction that stores what it makes.
const QUICK: Duration = Duration::from_millis(3);

/// How much the clocks of robots may differ, and how long an entry may be on its way.
const CLOCK_SKEW: Duration = Duration::from_secs(10);

/// The entries of the computables of a namespace.
pub(super) fn records(ns: &Namespace) -> Namespace {
    Namespace { database: ns.database.clone(), collection: COLLECTION.to_owned() }
}

/// Removes all entries for a collection whose documents are gone.
pub(in crate::memory) fn forget(store: &dyn Store, ns: &Namespace) -> Result<(), StoreError> {
    if ns.is_own() {
        return Ok(());
    }
    store.delete(&records(ns), (&doc! { "collection": &ns.collection }).into(), false).map(|_| ())
}

/// Writes to the cache, as one step where the store can. What a loss of power takes is computed again, so nothing waits
/// for the disk.
pub(super) fn write(store: &dyn Store, mut work: impl FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
    store.unflushed(&mut || store.atomically(&mut work))
}

/// The entry for a computable and a query.
pub(super) struct Entry<'a> {
    store: &'a dyn Store,
    /// The namespace that is asked.
    asked: &'a Namespace,
    records: Namespace,
    key: String,
    /// The state of the store in which the entry was read last; see [`Store::state`].
    seen: Cell<Option<(i64, u64)>>,
}

/// How long what was computed is there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lifetime {
    /// Until when equal queries are answered with it.
    pub(super) until: DateTime,
    /// Until when it is there for the query that it was computed for.
    pub(super) kept: DateTime,
}

/// How an entry stands.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum State {
    /// What this computation gave is good until then.
    Good { token: ObjectId, until: DateTime, documents: u64 },
    /// A process computes it, until then at most.
    Busy { until: DateTime },
    /// It has to be computed; what was computed before goes.
    Stale(Option<Former>),
}

/// An earlier computation, and what it made.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Former {
    /// The token of the entry, by which it is claimed.
    token: ObjectId,
    /// The computation that made documents.
    made: Option<ObjectId>,
    /// How many they are.
    documents: u64,
    /// Their `_id`s, where there are not too many.
    ids: Vec<Bson>,
    /// Whether the process that had the entry ended during its computation, and may have left documents.
    is_abandoned: bool,
    /// How long it took, where no other computation was a part of it.
    took: Option<Duration>,
    /// The entry as it was read.
    entry: Document,
}

impl Former {
    /// Whether it took so little time that other writers can wait until it is computed again.
    pub(super) fn was_quick(&self) -> bool {
        !self.is_abandoned && self.took.is_some_and(|took| took <= QUICK)
    }
}

/// A computation that is done.
#[derive(Debug, Clone, Copy)]
pub(super) struct Done<'a> {
    pub(super) token: ObjectId,
    /// The `_id`s of what it made.
    pub(super) ids: &'a [Bson],
    pub(super) life: Lifetime,
    /// How long it took, where no other computation was a part of it.
    pub(super) took: Option<Duration>,
}

impl<'a> Entry<'a> {
    pub(super) fn new(store: &'a dyn Store, asked: &'a Namespace, key: String) -> Self {
        Self { store, asked, records: records(asked), key, seen: Cell::default() }
    }

    /// The state of the store in which the entry was read last.
    pub(super) fn seen(&self) -> Option<(i64, u64)> {
        self.seen.get()
    }

    /// How the entry stands at a time. What ends further ahead than `cache`, by more than
    /// [`CLOCK_SKEW`], was written under another clock, and does not count.
    pub(super) fn state(&self, now: DateTime, cache: Duration) -> Result<State, StoreError> {
        let find = Find { filter: doc! { "_id": &self.key }, ..Find::default() };
        let found = self.store.find_chosen(&self.records, &mut |_| {
            self.seen.set(self.store.state());
            Ok(Some(Cow::Borrowed(&find)))
        })?;
        let found = found.and_then(|mut found| found.next()).transpose()?;
        let Some(found) = found else { return Ok(State::Stale(None)) };
        let entry = decode(&found)?;
        match state(&entry, now, after(now, cache.saturating_add(CLOCK_SKEW))) {
            good @ State::Good { .. } => {
                let former = former(&entry);
                Ok(if self.is_whole(&former)? { good } else { State::Stale(Some(former)) })
            }
            other => Ok(other),
        }
    }

    /// Whether the documents of a computation are as it made them, all of them.
    fn is_whole(&self, made: &Former) -> Result<bool, StoreError> {
        are_whole(self.store, self.asked, made.token, &made.ids, made.documents)
    }

    /// Claims the entry for a computation, until a time; returns whether that succeeded.
    pub(super) fn claim(
        &self,
        former: Option<&Former>,
        definition: &Definition,
        query: &Document,
        token: ObjectId,
        until: DateTime,
    ) -> Result<bool, StoreError> {
        let Some(former) = former else {
            let entry = doc! {
                "_id": &self.key,
                "collection": &self.asked.collection,
                "computable": &definition.name,
                "query": crate::formats::shell::relaxed(query),
                "token": token,
                "busy_until": until,
                "holder": Holder::myself().to_string(),
                metadata::INFO: { "computed": true, "cached_until": DateTime::from_millis(0), metadata::DECAY: until },
            };
            return match self.store.insert(&self.records, vec![entry]) {
                Ok(_) => Ok(true),
                Err(StoreError::Duplicate { .. }) => Ok(false),
                Err(error) => Err(error),
            };
        };
        let holder = Holder::myself().to_string();
        let set =
            doc! { "token": token, "busy_until": until, "holder": holder, metadata::info_path(metadata::DECAY): until };
        self.change(former.token, doc! { "$set": set })
    }

    /// Removes what an earlier computation made.
    pub(super) fn clear(&self, former: &Former) -> Result<(), StoreError> {
        remove(self.store, self.asked, former)
    }

    /// Records that a computation is done; returns false where another process has the entry.
    pub(super) fn finish(&self, done: Done<'_>) -> Result<bool, StoreError> {
        self.change(done.token, doc! { "$set": result(done), "$unset": { "busy_until": "", "holder": "" } })
    }

    /// Records that a computation is done that did not claim the entry: it is as it was, and no other process can write.
    pub(super) fn replace(&self, former: &Former, done: Done<'_>) -> Result<(), StoreError> {
        let mut entry = former.entry.clone();
        entry.insert("token", done.token);
        for (path, value) in result(done) {
            match (path.strip_prefix(metadata::INFO), entry.get_mut(metadata::INFO)) {
                (Some(key), Some(Bson::Document(info))) => info.insert(key.trim_start_matches('.'), value),
                _ => entry.insert(path, value),
            };
        }
        self.store.put(&self.records, vec![entry], None).map(drop)
    }

    /// Whether the entry is as it was when it was read, which no other connection can change now.
    pub(super) fn is_still(&self, former: &Former) -> Result<bool, StoreError> {
        if let (Some((before, _)), Some((now, _))) = (self.seen.get(), self.store.state())
            && before == now
        {
            return Ok(true);
        }
        Ok(!current(self.store, self.asked, &[(self.key.clone(), former.token)])?.is_empty())
    }

    /// Returns the entry free without a result.
    pub(super) fn release(&self, token: ObjectId, now: DateTime) -> Result<bool, StoreError> {
        self.change(
            token,
            doc! { "$set": { metadata::info_path(metadata::DECAY): now }, "$unset": { "busy_until": "", "holder": "" } },
        )
    }

    /// Removes some entries that are not good any more, and what they are about.
    pub(super) fn sweep(&self, now: DateTime) -> Result<(), StoreError> {
        let over = doc! { "$lte": now };
        let filter = doc! { "_id": { "$ne": &self.key }, metadata::info_path(metadata::DECAY): over };
        let find = Find { filter, limit: SWEEP, ..Find::default() };
        let entries = self.store.find(&self.records, &find)?.collect::<Result<Vec<_>, _>>()?;
        for entry in entries {
            let entry = Document::try_from(&*entry).map_err(QueryError::from)?;
            let (Some(id), State::Stale(Some(former))) = (entry.get("_id"), state(&entry, now, DateTime::MAX)) else {
                continue;
            };
            // A process that reads these documents sees by the missing entry that they are removed.
            if self.store.delete(&self.records, (&doc! { "_id": id, "token": former.token }).into(), true)? > 0 {
                let collection = entry.get_str("collection").unwrap_or(&self.asked.collection).to_owned();
                let asked = Namespace { database: self.asked.database.clone(), collection };
                remove(self.store, &asked, &former)?;
            }
        }
        Ok(())
    }

    fn change(&self, token: ObjectId, update: Document) -> Result<bool, StoreError> {
        let request = UpdateRequest {
            filter: doc! { "_id": &self.key, "token": token },
            update: UpdateSpec::Document(update),
            ..UpdateRequest::default()
        };
        Ok(self.store.update(&self.records, &request, None)?.matched > 0)
    }
}

/// What an entry says of its last computation.
fn result(done: Done<'_>) -> Document {
    doc! {
        "made": done.token,
        "documents": to_i64(done.ids.len()),
        "ids": listed(done.ids),
        "took": done.took.and_then(|took| i64::try_from(took.as_micros()).ok()),
        metadata::info_path("cached_until"): done.life.until,
        metadata::info_path(metadata::DECAY): done.life.kept,
    }
}

/// Which of the entries still have their tokens: their keys.
pub(super) fn current(
    store: &dyn Store,
    ns: &Namespace,
    entries: &[(String, ObjectId)],
) -> Result<Vec<String>, StoreError> {
    let keys: Vec<&str> = entries.iter().map(|(key, _)| key.as_str()).collect();
    let find = Find { filter: doc! { "_id": { "$in": keys } }, projection: doc! { "token": 1 }, ..Find::default() };
    let mut current = Vec::new();
    for entry in store.find(&records(ns), &find)? {
        let entry = Document::try_from(&*entry?).map_err(QueryError::from)?;
        let (Ok(key), Ok(token)) = (entry.get_str("_id"), entry.get_object_id("token")) else { continue };
        if entries.iter().any(|(other, wanted)| other == key && *wanted == token) {
            current.push(key.to_owned());
        }
    }
    Ok(current)
}

/// The `_id`s of a computation, where there are not too many.
pub(super) fn listed(ids: &[Bson]) -> &[Bson] {
    if ids.len() > MOST_IDS { &[] } else { ids }
}

/// Whether the documents of a computation are as it made them, all of them. `ids` are theirs, or empty where they are
/// not known.
pub(super) fn are_whole(
    store: &dyn Store,
    ns: &Namespace,
    token: ObjectId,
    ids: &[Bson],
    documents: u64,
) -> Result<bool, StoreError> {
    if documents == 0 {
        return Ok(true);
    }
    let mut unchanged = doc! { metadata::computation("token"): token };
    if !ids.is_empty() {
        unchanged.insert("_id", doc! { "$in": ids });
    }
    unchanged.insert(metadata::info_path(metadata::UPDATED), Bson::Null);
    Ok(store.count(ns, (&unchanged).into())? == documents)
}

/// Removes an entry; returns false where it is of another computation meanwhile.
pub(super) fn discard(store: &dyn Store, ns: &Namespace, key: &str, token: ObjectId) -> Result<bool, StoreError> {
    Ok(store.delete(&records(ns), (&doc! { "_id": key, "token": token }).into(), true)? > 0)
}

/// Removes what a computation made.
fn remove(store: &dyn Store, ns: &Namespace, former: &Former) -> Result<(), StoreError> {
    if former.is_abandoned {
        store.delete(ns, (&doc! { metadata::computation("token"): former.token }).into(), false)?;
    }
    let Some(made) = former.made else { return Ok(()) };
    let own = doc! { metadata::computation("token"): made };
    if former.ids.is_empty() {
        return store.delete(ns, (&own).into(), false).map(|_| ());
    }
    for ids in former.ids.chunks(1000) {
        let mut filter = doc! { "_id": { "$in": ids } };
        filter.extend(own.clone());
        store.delete(ns, (&filter).into(), false)?;
    }
    Ok(())
}

/// How an entry stands at a time; what ends after `latest` does not count.
fn state(entry: &Document, now: DateTime, latest: DateTime) -> State {
    let Ok(token) = entry.get_object_id("token") else { return State::Stale(None) };
    let claimed = entry.get_datetime("busy_until");
    if let Ok(until) = claimed
        && *until > now
        && !is_dead(entry)
    {
        return State::Busy { until: *until };
    }
    let former = former(entry);
    let until = entry.get_document(metadata::INFO).and_then(|info| info.get_datetime("cached_until"));
    match until {
        Ok(until) if *until > now && *until <= latest && entry.get_object_id("made").ok() == Some(token) => {
            State::Good { token, until: *until, documents: former.documents }
        }
        _ => State::Stale(Some(former)),
    }
}

/// The computation that an entry is about, where it is one.
fn former(entry: &Document) -> Former {
    let documents = u64::try_from(entry.get_i64("documents").unwrap_or_default()).unwrap_or_default();
    let took = entry.get_i64("took").ok().and_then(|took| u64::try_from(took).ok());
    Former {
        token: entry.get_object_id("token").unwrap_or_default(),
        // Nothing was made where no documents are counted.
        made: entry.get_object_id("made").ok().filter(|_| documents > 0),
        documents,
        ids: entry.get_array("ids").cloned().unwrap_or_default(),
        is_abandoned: entry.contains_key("busy_until"),
        took: took.map(Duration::from_micros),
        entry: entry.clone(),
    }
}

/// Whether the process that claimed an entry is known to have ended.
fn is_dead(entry: &Document) -> bool {
    let holder = entry.get_str("holder").ok().and_then(|holder| holder.parse::<Holder>().ok());
    holder.is_some_and(|holder| holder.life() == Life::Over)
}

/// How long after `now`.
pub(super) fn after(now: DateTime, by: Duration) -> DateTime {
    let by = to_i64(by.as_millis());
    DateTime::from_millis(now.timestamp_millis().saturating_add(by))
}
