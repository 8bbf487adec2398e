//! The history of collections on a server: kept in the collection `rmem.history` of each database.
//!
//! It is filled from change streams, by a watch whose position the server keeps (`position`). Whoever
//! writes by rmem, reads the history, or runs `rmem record`, goes on from that position: so what other
//! clients change is recorded, too, and a process that is killed between its write and the recording
//! leaves that to the next. An entry's `_id` is the position of its change, so none is recorded twice.
//! rmem signs its own changes once they are recorded.
//!
//! Where rmem writes the date of a change in a second step, that belongs to the entry of the change: to the last one of the
//! document that has no date of its own. Of documents that have no room in an entry, or in an event of the server, the dates
//! alone are kept.

use std::collections::hash_map::Entry::Vacant;
use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::{Duration, Instant};

use bson::raw::RawBsonRef;
use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf, Timestamp, doc};
use mongodb::sync::Collection;

use super::keeping::Owed;
use super::position::HISTORY;
use super::{MongoDb, failure};
use crate::query::{QueryError, key};
use crate::saturate::to_i64;
use crate::store::history::{Entry, History, HistoryRule, not_kept, too_old};
use crate::store::metadata::{INFO, INSERTED, UPDATED, info_path};
use crate::store::{Change, ChangeKind, Changes, Documents, Find, Namespace, Next, Store as _, StoreError};

/// The collection of entries: `{_id, ns, operation, document, computed, time, before, after, dates, by, run}`.
const ENTRIES: &str = "rmem.history";
/// The collection that says since when the history of a collection is whole: `{_id, since}`.
const BEGINNINGS: &str = "rmem.histories";
/// The collection of the runs of which changes are not kept any more: `{_id: {ns, run}, at}`.
const CUT_RUNS: &str = "rmem.cut_runs";
/// How long one waits for one's own changes while no more of them come.
const OWN_TIMEOUT: Duration = Duration::from_secs(2);
/// How long one waits for them while only changes of others come.
const OTHERS_TIMEOUT: Duration = Duration::from_secs(10);
/// How long no change may come until the history counts as read to its end.
const QUIET_TIME: Duration = Duration::from_millis(300);
/// Images of more bytes are left out: an entry is a document, which has at most 16 MiB.
const LARGEST_IMAGES: usize = 15 << 20;
/// So many changes are written at once.
const BATCH: usize = 200;
/// About so many bytes of documents.
const BATCH_BYTES: usize = 8 << 20;
/// So many changes of others are recorded at once while one waits for one's own, at most.
const MOST_OF_OTHERS: u64 = 2_000;
/// Of so many documents it is known which entries are the last ones.
const MOST_KNOWN: usize = 100_000;
/// So many of each document.
const RECENT: usize = 16;

/// Which changes a write made, as a filter on entries, and how many.
pub(super) struct Made {
    count: u64,
    filter: Document,
    /// Whether the filter tells them from all later changes.
    is_exact: bool,
}

impl Made {
    /// What was stored under these `_id`s.
    pub(super) fn inserts(ids: &[Bson]) -> Self {
        let filter = doc! { "operation": "insert", "document": { "$in": ids } };
        Self { count: ids.len() as u64, filter, is_exact: true }
    }

    /// What was changed or inserted with this date; of what was inserted, the documents with these `_id`s, where they are known.
    pub(super) fn dated(count: u64, at: Option<DateTime>, inserted: Option<&[Bson]>) -> Self {
        let Some(at) = at else { return Self { count, filter: Document::new(), is_exact: false } };
        let dated = |key: &str| {
            let paths = [format!("after.{}", info_path(key)), format!("dates.{key}")];
            paths.into_iter().map(|path| doc! { path: at }).collect::<Vec<_>>()
        };
        // Others may have inserted something at the same time.
        let mut inserts = doc! { "operation": "insert", "$or": dated(INSERTED) };
        inserts.extend(inserted.map(|ids| ("document".to_owned(), doc! { "$in": ids }.into())));
        let changes = doc! { "operation": { "$in": ["update", "replace"] }, "$or": dated(UPDATED) };
        Self { count, filter: doc! { "$or": [changes, inserts] }, is_exact: true }
    }

    /// What cannot be told from what others did.
    pub(super) fn unknown() -> Self {
        Self { count: 0, filter: Document::new(), is_exact: false }
    }

    /// What was removed: the documents with these `_id`s, where they are known.
    pub(super) fn removals(count: u64, ids: &[Bson]) -> Self {
        let mut filter = doc! { "operation": { "$in": ["delete", "drop"] } };
        if !ids.is_empty() {
            filter.insert("document", doc! { "$in": ids });
        }
        Self { count, filter, is_exact: !ids.is_empty() }
    }
}

/// What is to be written into the history.
#[derive(Default)]
struct Batch {
    entries: Vec<Document>,
    /// Statements that add the date of a change to its entry.
    dates: Vec<Document>,
    bytes: usize,
    /// The last entries of each document, where they were recorded a moment ago.
    last: HashMap<Vec<u8>, VecDeque<Recent>>,
}

/// An entry that the date of a change may belong to.
struct Recent {
    position: String,
    updated: Option<DateTime>,
    /// Whether the change wrote the date itself.
    is_dated: bool,
}

impl Recent {
    fn new(position: &str, [before, after]: [Option<&RawDocument>; 2]) -> Self {
        let of = |image: Option<&RawDocument>| image.and_then(|image| dates(image).get_datetime(UPDATED).ok().copied());
        let updated = of(after);
        let is_dated = before.is_some() && updated.is_some() && updated != of(before);
        Self { position: position.to_owned(), updated, is_dated }
    }

    /// Whether a date may belong to it: also where it was given it already, and the change of the date is read again.
    fn takes(&self, date: Option<DateTime>) -> bool {
        !self.is_dated || self.updated == date
    }
}

/// A moment, by the server.
#[derive(Clone, Copy)]
struct Moment {
    time: DateTime,
    /// Behind the last change that it had.
    position: Option<Timestamp>,
}

/// What was recorded of the changes of a collection.
struct Caught {
    count: u64,
    /// Up to which time of the server nothing is left, where that is known.
    reached: Option<Timestamp>,
}

impl Batch {
    fn add(&mut self, ns: &Namespace, change: &Change) -> Result<(), QueryError> {
        self.entries.push(entry(ns, change)?);
        self.bytes +=
            [&change.before, &change.after].into_iter().flatten().map(|image| image.as_bytes().len()).sum::<usize>();
        if let Some(id) = &change.id {
            let last = self.last.entry(key::encode_value(id)).or_default();
            if last.len() == RECENT {
                last.pop_front();
            }
            last.push_back(Recent::new(&change.position, [change.before.as_deref(), change.after.as_deref()]));
        }
        Ok(())
    }

    /// The entry of a document that a date belongs to, where it was recorded a moment ago.
    fn take(&mut self, id: &Bson, updated: Option<DateTime>) -> Option<String> {
        let last = self.last.get_mut(&key::encode_value(id))?;
        let recent = last.iter_mut().rev().find(|recent| recent.takes(updated))?;
        (recent.updated, recent.is_dated) = (updated, true);
        Some(recent.position.clone())
    }

    /// Adds the date of the change that an entry is about.
    fn add_date(&mut self, entry: &str, dated: &RawDocument) -> Result<(), QueryError> {
        let statement = |has_images: bool, set: Document| {
            let is_there = doc! { "$exists": has_images };
            doc! { "q": { "_id": entry, "after": is_there }, "u": { "$set": set } }
        };
        if has_id(dated) {
            self.bytes += dated.as_bytes().len();
            self.dates.push(statement(true, doc! { "after": Document::try_from(dated)? }));
        }
        self.dates.push(statement(false, doc! { "dates": dates(dated) }));
        Ok(())
    }

    fn is_full(&self) -> bool {
        self.entries.len() + self.dates.len() >= BATCH || self.bytes >= BATCH_BYTES
    }
}

/// While this lives, a write is being recorded; also where that panics, no longer.
struct Recording<'a>(&'a MongoDb);

impl<'a> Recording<'a> {
    fn begin(store: &'a MongoDb) -> Self {
        store.keeping().is_recording = true;
        Self(store)
    }
}

impl Drop for Recording<'_> {
    fn drop(&mut self) {
        self.0.keeping().is_recording = false;
    }
}

impl MongoDb {
    fn keeping(&self) -> std::sync::MutexGuard<'_, super::keeping::Keeping> {
        self.keeping.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    pub(super) fn set_history(&self, rules: &[HistoryRule]) {
        self.keeping().rules = rules.to_vec();
    }

    pub(super) fn set_author(&self, author: &str) {
        self.keeping().sign(author);
    }

    /// Forgets which histories have begun, where what is kept of them is gone with a collection.
    pub(super) fn forget_history(&self, gone: &Namespace) {
        if gone.is_own() {
            self.keeping().begun.retain(|ns| ns.database != gone.database);
        }
    }

    /// Why the last write is not in the history, where that was not told yet.
    pub(super) fn take_unrecorded(&self) -> Option<String> {
        self.keeping().unrecorded.take()
    }

    /// The time of a change. Where the history is kept, changes are known by it as this process's: no two have the same.
    pub(super) fn time_of_change(&self, ns: &Namespace, asked: Option<DateTime>) -> Option<DateTime> {
        let at = asked?;
        Some(if self.rule(ns).is_some() { DateTime::from_millis(next_time(at.timestamp_millis())) } else { at })
    }

    /// Whether what is changed in a collection is recorded.
    pub(super) fn records(&self, ns: &Namespace) -> bool {
        self.rule(ns).is_some() && !self.keeping().is_recording
    }

    fn rule(&self, ns: &Namespace) -> Option<HistoryRule> {
        HistoryRule::of(&self.keeping().rules, ns).cloned()
    }

    fn entries(&self, ns: &Namespace) -> Collection<Document> {
        self.client().database(&ns.database).collection(ENTRIES)
    }

    fn cut_runs(&self, ns: &Namespace) -> Collection<Document> {
        self.client().database(&ns.database).collection(CUT_RUNS)
    }

    fn beginnings(&self, ns: &Namespace) -> Collection<Document> {
        self.client().database(&ns.database).collection(BEGINNINGS)
    }

    /// Writes, and records what was changed, where the history is kept: also where the write failed after some of its
    /// changes.
    pub(super) fn recorded<T>(
        &self,
        ns: &Namespace,
        made: impl FnOnce(Result<&T, &StoreError>) -> Made,
        work: impl FnOnce() -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let Some(rule) = self.rule(ns).filter(|_| !self.keeping().is_recording) else { return work() };
        self.begin(ns)?;
        let start = self.moment()?;
        let mut owed = Owed::take(&self.address, ns);
        let recording = Recording::begin(self);
        let done = work();
        drop(recording);
        let made = made(done.as_ref());
        let may_be_made = matches!(done, Err(StoreError::Unreachable { may_be_done: true, .. }));
        if made.count > 0 || may_be_made {
            owed.push(self.signature(ns, &made, start.time));
        }
        let recorded = self.record_own(ns, &rule, (made.count, start), &mut owed);
        // Those whose changes are not recorded yet.
        Owed::keep(owed);
        match (done, recorded) {
            // What was done is recorded later: the next one who records goes on where this one ended.
            (done, Ok(()) | Err(StoreError::Unreachable { .. })) => done,
            (Ok(done), Err(error)) => self.tell_unrecorded(ns, &error).map(|()| done),
            // Of two failures, that of the write is the first.
            (done, Err(_)) => done,
        }
    }

    /// Says that a write was done, and is not in the history: to those who ask for it behind the write, else as the error of
    /// the write.
    fn tell_unrecorded(&self, ns: &Namespace, error: &StoreError) -> Result<(), StoreError> {
        let reason = format!("the change of {ns} was made, but could not be recorded in the history: {error}");
        if !self.write_policy.is_postponed() {
            return Err(StoreError::Unconfirmed { address: self.address.clone(), reason });
        }
        self.keeping().unrecorded = Some(reason);
        Ok(())
    }

    /// How the changes of a write are signed that began at a time.
    fn signature(&self, ns: &Namespace, made: &Made, start: DateTime) -> Owed {
        let mut entries = made.filter.clone();
        entries.extend(doc! { "ns": ns.to_string(), "by": { "$exists": false }, "time": { "$gte": start } });
        let keeping = self.keeping();
        let signature = doc! { "$set": { "by": &keeping.author, "run": keeping.run } };
        Owed { address: self.address.clone(), namespace: ns.clone(), entries, signature, is_exact: made.is_exact }
    }

    /// Makes the watch of a collection, before the first change that it is to record.
    fn begin(&self, ns: &Namespace) -> Result<(), StoreError> {
        if self.keeping().begun.contains(ns) {
            return Ok(());
        }
        let known = self.beginnings(ns).find_one(doc! { "_id": &ns.collection }).run().map_err(|e| self.explain(&e))?;
        let is_known = match self.follow_for_history(ns, &name(ns), None) {
            Ok(changes) => known.is_some() && !changes.is_new(),
            // Another process records at this moment.
            Err(StoreError::Held { .. }) => known.is_some(),
            Err(error) => return Err(error),
        };
        if !is_known {
            self.begin_at(ns, self.moment()?.time)?;
        }
        let indexes = [
            doc! { "key": { "ns": 1, "_id": 1 }, "name": "ns_1__id_1" },
            doc! { "key": { "ns": 1, "time": 1 }, "name": "ns_1_time_1" },
        ];
        let indexes = doc! { "createIndexes": ENTRIES, "indexes": indexes.to_vec() };
        self.client().database(&ns.database).run_command(indexes).run().map_err(|e| self.explain(&e))?;
        self.keeping().begun.insert(ns.clone());
        Ok(())
    }

    /// Notes that the history of a collection is whole since a time.
    fn begin_at(&self, ns: &Namespace, since: DateTime) -> Result<(), StoreError> {
        let set = doc! { "$max": { "since": since } };
        let own = doc! { "_id": &ns.collection };
        self.beginnings(ns).update_one(own, set).upsert(true).run().map(drop).map_err(|e| self.explain(&e))
    }

    /// Now.
    fn moment(&self) -> Result<Moment, StoreError> {
        let hello = self.client().database("admin").run_command(doc! { "hello": 1 }).run();
        let hello = hello.map_err(|e| self.explain(&e))?;
        let behind = |last: Timestamp| Timestamp { increment: last.increment.saturating_add(1), ..last };
        Ok(Moment {
            time: hello.get_datetime("localTime").copied().unwrap_or_else(|_| DateTime::now()),
            position: hello.get_timestamp("operationTime").ok().map(behind),
        })
    }

    /// Records the changes up to those of a write that began at a time, of which there are `count`, and signs these, the last of
    /// what is owed. What is owed from before lies before them, so that nothing is owed then.
    fn record_own(
        &self,
        ns: &Namespace,
        rule: &HistoryRule,
        (count, start): (u64, Moment),
        owed: &mut Vec<Owed>,
    ) -> Result<(), StoreError> {
        let Some(own) = owed.last().filter(|_| count > 0) else { return Ok(()) };
        // Behind the last change of the write.
        let end = self.moment()?.position;
        let (begun, mut signed, mut batch) = (Instant::now(), 0, Batch::default());
        let (mut progress, mut is_read) = (begun, false);
        // Where others write meanwhile, more and more is taken at once, so as to come by them.
        let mut most = count;
        while signed < count && !is_read && progress.elapsed() < OWN_TIMEOUT {
            // While another process records, one waits for it.
            let recorded = self.catch_up(ns, rule, &mut batch, (Duration::from_millis(50), most), Some(start))?;
            if recorded.count == 0 {
                std::thread::sleep(Duration::from_millis(5));
            }
            most = most.max((most * 2).min(MOST_OF_OTHERS));
            // Of the time of the last change there may be more, until a later one is reached.
            is_read = recorded.reached.zip(end).is_some_and(|(reached, end)| reached >= end);
            let more = self.sign_entries(ns, own)?;
            signed += more;
            if more > 0 || (recorded.count > 0 && begun.elapsed() < OTHERS_TIMEOUT) {
                progress = Instant::now();
            }
        }
        // Where all was read, what is not signed by now is another's.
        if signed >= count || is_read {
            owed.pop();
            while let Some(before) = owed.last() {
                self.sign_entries(ns, before)?;
                owed.pop();
            }
        }
        Ok(())
    }

    fn sign_entries(&self, ns: &Namespace, owed: &Owed) -> Result<u64, StoreError> {
        let signed = self.entries(ns).update_many(owed.entries.clone(), owed.signature.clone()).run();
        Ok(signed.map_err(|e| self.explain(&e))?.modified_count)
    }

    /// Records the changes that are there, and their dates, at most so many, where no more come for a while; where nothing was
    /// recorded before, those since a moment.
    fn catch_up(
        &self,
        ns: &Namespace,
        rule: &HistoryRule,
        batch: &mut Batch,
        (lull, most): (Duration, u64),
        since: Option<Moment>,
    ) -> Result<Caught, StoreError> {
        let mut changes = match self.follow_for_history(ns, &name(ns), since.and_then(|since| since.position)) {
            Ok(changes) => changes,
            Err(StoreError::Held { .. }) => return Ok(Caught { count: 0, reached: None }),
            Err(error) => return Err(error),
        };
        if changes.is_new() {
            // The database was dropped, and the history with it.
            let since = since.map_or_else(|| self.moment(), Ok)?;
            self.begin_at(ns, since.time)?;
        }
        // Others may have recorded later changes since.
        batch.last.clear();
        let mut count = 0;
        while count < most {
            match changes.next(lull)? {
                Next::Change(change) => batch.add(ns, &change)?,
                Next::Nothing | Next::Interrupted(_) => match changes.take_date() {
                    Some(date) => self.date(ns, &date, batch)?,
                    None => break,
                },
            }
            count += 1;
            if batch.is_full() {
                self.keep(ns, batch, &mut changes)?;
            }
        }
        self.keep(ns, batch, &mut changes)?;
        if count > 0 {
            self.bound(ns, rule)?;
        }
        Ok(Caught { count, reached: changes.reached() })
    }

    /// Writes entries, and that they are written.
    fn keep(&self, ns: &Namespace, batch: &mut Batch, changes: &mut dyn Changes) -> Result<(), StoreError> {
        if !batch.entries.is_empty() {
            let kept = self.entries(ns).insert_many(batch.entries.drain(..)).ordered(false).run();
            // Another process may have recorded some already.
            kept.map(drop)
                .or_else(|error| if failure::is_of_taken_keys(&error) { Ok(()) } else { Err(self.explain(&error)) })?;
        }
        if !batch.dates.is_empty() {
            let statements = std::mem::take(&mut batch.dates);
            let dates = doc! { "update": ENTRIES, "updates": statements, "ordered": false };
            self.client().database(&ns.database).run_command(dates).run().map_err(|e| self.explain(&e))?;
        }
        batch.bytes = 0;
        // What was recorded is found again by its document.
        if batch.last.len() >= MOST_KNOWN {
            batch.last.clear();
        }
        changes.done()
    }

    /// Adds a date to the entry of its change: the last one of the document before it that has none of its own.
    fn date(&self, ns: &Namespace, date: &Change, batch: &mut Batch) -> Result<(), StoreError> {
        let (Some(id), Some(dated)) = (&date.id, &date.after) else { return Ok(()) };
        let updated = dates(dated).get_datetime(UPDATED).ok().copied();
        let entry = match batch.take(id, updated) {
            Some(entry) => Some(entry),
            None => {
                self.recent(ns, id, &date.position)?.into_iter().find(|entry| entry.takes(updated)).map(|e| e.position)
            }
        };
        Ok(entry.map_or(Ok(()), |entry| batch.add_date(&entry, dated))?)
    }

    /// The last entries of a document before a position, the last one first.
    fn recent(&self, ns: &Namespace, id: &Bson, before: &str) -> Result<Vec<Recent>, StoreError> {
        let filter = doc! { "ns": ns.to_string(), "_id": { "$lt": before }, "document": { "$eq": id } };
        let info = |image: &str| (format!("{image}.{INFO}"), Bson::from(1));
        let place = Namespace { database: ns.database.clone(), collection: ENTRIES.to_owned() };
        let projection = [info("before"), info("after")].into_iter().collect();
        let find = Find {
            filter,
            sort: doc! { "_id": -1 },
            limit: RECENT as u64,
            projection,
            current: true,
            ..Find::default()
        };
        let entry = |entry: RawDocumentBuf| {
            let image = |key: &str| entry.get_document(key).ok();
            Recent::new(entry.get_str("_id").unwrap_or_default(), [image("before"), image("after")])
        };
        self.find(&place, &find)?.map(|found| found.map(entry)).collect()
    }

    /// Lets go of entries that are too old or too many.
    fn bound(&self, ns: &Namespace, rule: &HistoryRule) -> Result<(), StoreError> {
        let oldest = self.oldest(rule)?;
        let old = doc! { "ns": ns.to_string(), "time": { "$lt": oldest } };
        if self.entries(ns).find_one(old.clone()).run().map_err(|e| self.explain(&e))?.is_some() {
            self.remove_entries(ns, old)?;
            // What was there when a run was noted is gone by now.
            let gone = doc! { "_id.ns": ns.to_string(), "at": { "$lt": oldest } };
            self.cut_runs(ns).delete_many(gone).run().map_err(|e| self.explain(&e))?;
        }
        let statistics = doc! { "collStats": ENTRIES };
        let statistics = self.client().database(&ns.database).run_command(statistics).run();
        let statistics = statistics.map_err(|e| self.explain(&e))?;
        let number = |key: &str| match statistics.get(key) {
            Some(Bson::Int32(number)) => u64::try_from(*number).unwrap_or_default(),
            Some(Bson::Int64(number)) => u64::try_from(*number).unwrap_or_default(),
            _ => 0,
        };
        if number("size") > rule.size { self.cut(ns, number("count") / 4 + 1) } else { Ok(()) }
    }

    /// Removes the oldest entries of a database.
    fn cut(&self, ns: &Namespace, count: u64) -> Result<(), StoreError> {
        let first = self.entries(ns).find(doc! {}).sort(doc! { "_id": 1 }).skip(count).limit(1).run();
        let first = first.map_err(|e| self.explain(&e))?.next().transpose().map_err(|e| self.explain(&e))?;
        let Some(first) = first else { return Ok(()) };
        let (id, time) = (first.get("_id").cloned().unwrap_or(Bson::Null), first.get_datetime("time").copied());
        if let Ok(time) = time {
            let all = self.beginnings(ns).update_many(doc! {}, doc! { "$max": { "since": time } }).run();
            all.map_err(|e| self.explain(&e))?;
        }
        self.remove_entries(ns, doc! { "_id": { "$lt": id } })
    }

    /// Notes the runs whose changes go, and then removes these.
    fn remove_entries(&self, ns: &Namespace, entries: Document) -> Result<(), StoreError> {
        let runs = [
            doc! { "$match": { "$and": [&entries, { "run": { "$exists": true } }] } },
            doc! { "$group": { "_id": { "ns": "$ns", "run": "$run" } } },
            doc! { "$set": { "at": "$$NOW" } },
            doc! { "$merge": { "into": CUT_RUNS, "whenMatched": "replace" } },
        ];
        self.entries(ns).aggregate(runs).run().map_err(|e| self.explain(&e))?;
        self.entries(ns).delete_many(entries).run().map(drop).map_err(|e| self.explain(&e))
    }

    /// The runs of which the history of a collection has not all changes.
    fn runs_cut(&self, ns: &Namespace, current: bool) -> Result<HashSet<i64>, StoreError> {
        let place = Namespace { database: ns.database.clone(), collection: CUT_RUNS.to_owned() };
        let find = Find { filter: doc! { "_id.ns": ns.to_string() }, current, ..Find::default() };
        let run = |noted: RawDocumentBuf| noted.get_document("_id").ok()?.get_i64("run").ok();
        self.find(&place, &find)?.filter_map(|noted| noted.map(run).transpose()).collect()
    }

    fn oldest(&self, rule: &HistoryRule) -> Result<DateTime, StoreError> {
        let age = to_i64(rule.age.as_millis());
        Ok(DateTime::from_millis(self.moment()?.time.timestamp_millis().saturating_sub(age)))
    }

    /// Since when the history of a collection is whole; nothing where none is kept.
    fn beginning(&self, ns: &Namespace) -> Result<Option<DateTime>, StoreError> {
        let found = self.beginnings(ns).find_one(doc! { "_id": &ns.collection }).run().map_err(|e| self.explain(&e))?;
        let Some(since) = found.and_then(|found| found.get_datetime("since").ok().copied()) else { return Ok(None) };
        match self.rule(ns) {
            Some(rule) => Ok(Some(since.max(self.oldest(&rule)?))),
            None => Ok(Some(since)),
        }
    }

    pub(super) fn past(&self, ns: &Namespace, after: Option<DateTime>) -> Result<Option<History<'_>>, StoreError> {
        let Some(since) = self.beginning(ns)? else { return Ok(None) };
        if let Some(rule) = self.rule(ns) {
            self.catch_up(ns, &rule, &mut Batch::default(), (QUIET_TIME, u64::MAX), None)?;
        }
        // What was written a moment ago is a part of it; the other members may be behind the primary.
        let current = self.rule(ns).is_some();
        let after = after.unwrap_or(DateTime::from_millis(i64::MIN));
        let filter = doc! { "ns": ns.to_string(), "time": { "$gt": after }, "computed": { "$ne": true } };
        let place = Namespace { database: ns.database.clone(), collection: ENTRIES.to_owned() };
        let find = Find { filter, sort: doc! { "_id": 1 }, current, ..Find::default() };
        let found: Documents<'_> = self.find(&place, &find)?;
        let entries = found.map(|document| read(&document?).map_err(StoreError::from));
        Ok(Some(History { since, cut_runs: self.runs_cut(ns, current)?, entries: Box::new(entries) }))
    }

    pub(super) fn rewound(&self, ns: &Namespace, at: DateTime) -> Result<Vec<RawDocumentBuf>, StoreError> {
        // The documents first: what is changed from here on is in the history.
        let now: Vec<RawDocumentBuf> =
            self.find(ns, &Find { current: self.rule(ns).is_some(), ..Find::default() })?.collect::<Result<_, _>>()?;
        let history = self.past(ns, Some(at))?.ok_or_else(|| not_kept(ns, &self.keeping().rules))?;
        if at < history.since {
            return Err(too_old(ns, at, history.since));
        }
        let (mut changed, mut order) = (HashMap::new(), Vec::new());
        for entry in history.entries {
            let change = entry?.change;
            let (Some(id), true) = (&change.id, change.kind != ChangeKind::Drop) else {
                return Err(too_old(ns, at, change.time));
            };
            if change.before.is_none() && change.kind != ChangeKind::Insert {
                return Err(too_old(ns, at, change.time));
            }
            let key = key::encode_value(id);
            if let Vacant(first) = changed.entry(key) {
                order.push(first.key().clone());
                first.insert(change.before);
            }
        }
        let mut documents = Vec::with_capacity(now.len());
        for document in now {
            match changed.remove(&id_key(&document)?) {
                None if !is_computed(&document) => documents.push(document),
                None => {}
                Some(before) => documents.extend(before),
            }
        }
        documents.extend(order.iter().filter_map(|key| changed.remove(key).flatten()));
        Ok(documents)
    }

    /// Records what all clients change, until `stop`; returns how many changes.
    pub(super) fn record_all(
        &self,
        ns: &Namespace,
        stop: &AtomicBool,
        begun: &mut dyn FnMut(),
    ) -> Result<u64, StoreError> {
        let rule = self.rule(ns).ok_or_else(|| not_kept(ns, &[]))?;
        self.begin(ns)?;
        let mut changes = self.follow_for_history(ns, &name(ns), None)?;
        begun();
        let (mut total, mut looked, mut batch) = (0, Instant::now(), Batch::default());
        while !stop.load(Ordering::Relaxed) {
            match changes.next(QUIET_TIME)? {
                Next::Change(change) => {
                    total += 1;
                    batch.add(ns, &change)?;
                    self.keep(ns, &mut batch, &mut changes)?;
                }
                Next::Nothing => {
                    if let Some(date) = changes.take_date() {
                        self.date(ns, &date, &mut batch)?;
                        self.keep(ns, &mut batch, &mut changes)?;
                    }
                }
                // The next call connects again.
                Next::Interrupted(_) => std::thread::sleep(QUIET_TIME),
            }
            if looked.elapsed() > Duration::from_secs(10) {
                self.bound(ns, &rule)?;
                looked = Instant::now();
            }
        }
        changes.done()?;
        Ok(total)
    }
}

/// A time in milliseconds, from this one on, that was not given before.
fn next_time(from: i64) -> i64 {
    static LAST: AtomicI64 = AtomicI64::new(i64::MIN);
    let next = |last: i64| Some(from.max(last.saturating_add(1)));
    let last = LAST.fetch_update(Ordering::Relaxed, Ordering::Relaxed, next);
    next(last.unwrap_or_else(|last| last)).unwrap_or(from)
}

fn name(ns: &Namespace) -> String {
    format!("{HISTORY}{}", ns.collection)
}

fn is_computed(document: &RawDocument) -> bool {
    crate::store::metadata::is_computed(document).unwrap_or(false)
}

fn id_key(document: &RawDocument) -> Result<Vec<u8>, QueryError> {
    Ok(document.get("_id")?.map(key::encode).unwrap_or_default())
}

/// A change as it is written.
fn entry(ns: &Namespace, change: &Change) -> Result<Document, QueryError> {
    let mut entry =
        doc! { "_id": &change.position, "ns": ns.to_string(), "operation": change.kind.name(), "time": change.time };
    entry.extend(change.id.clone().map(|id| ("document".to_owned(), id)));
    if change.after.as_deref().or(change.before.as_deref()).is_some_and(is_computed) {
        entry.insert("computed", true);
    }
    let size = |image: &Option<RawDocumentBuf>| image.as_ref().map_or(0, |image| image.as_bytes().len());
    // Of what had no room in an event, the metadata is there.
    let is_whole = change.after.as_deref().is_none_or(has_id);
    if !is_whole || size(&change.before) + size(&change.after) > LARGEST_IMAGES {
        entry.extend(change.after.as_deref().map(|after| ("dates".to_owned(), dates(after).into())));
    } else {
        for (key, image) in [("before", &change.before), ("after", &change.after)] {
            if let Some(image) = image {
                entry.insert(key, Document::try_from(&**image)?);
            }
        }
    }
    Ok(entry)
}

fn has_id(document: &RawDocument) -> bool {
    matches!(document.get("_id"), Ok(Some(_)))
}

/// When a document was inserted and changed, as its metadata says.
fn dates(document: &RawDocument) -> Document {
    let Ok(info) = document.get_document(INFO) else { return Document::new() };
    let date = |key: &str| info.get_datetime(key).ok().map(|date| (key.to_owned(), date.into()));
    [INSERTED, UPDATED].into_iter().filter_map(date).collect()
}

/// An entry as it was written.
fn read(document: &RawDocument) -> Result<Entry, QueryError> {
    let image = |key: &str| match document.get(key) {
        Ok(Some(RawBsonRef::Document(image))) => Ok(Some(image.to_owned())),
        Ok(_) => Ok(None),
        Err(error) => Err(QueryError::from(error)),
    };
    let text = |key: &str| document.get_str(key).ok().map(str::to_owned);
    let operation = text("operation").unwrap_or_default();
    use ChangeKind::{Delete, Drop, Insert, Replace, Update};
    let kind = [Insert, Update, Replace, Delete, Drop].into_iter().find(|kind| kind.name() == operation);
    let id = document.get("document")?.map(Bson::try_from).transpose()?;
    let time = document.get_datetime("time").unwrap_or(DateTime::from_millis(0));
    let change = Change {
        kind: kind
            .ok_or_else(|| QueryError::bad_value(format!("an entry of {ENTRIES} has the operation `{operation}`")))?,
        id,
        before: image("before")?,
        after: image("after")?,
        time,
        position: text("_id").unwrap_or_default(),
    };
    Ok(Entry { change, dropped: false, author: text("by"), run: document.get_i64("run").ok(), collation: None })
}

#[cfg(test)]
mod tests {
    use super::next_time;

    #[test]
    fn no_two_changes_of_a_process_have_the_same_time() {
        let first = next_time(5_000_000_000_000);
        let later = [first, first, first - 7, first + 100].map(next_time);
        assert_eq!(later, [first + 1, first + 2, first + 3, first + 100]);
    }
}
