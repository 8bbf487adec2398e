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

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::{Duration, Instant};

use bson::{Bson, DateTime, Document, RawDocumentBuf, Timestamp, doc};
use mongodb::sync::Collection;

use super::entry::{Batch, ENTRIES, RECENT, Recent, dates};
use super::keeping::Owed;
use super::position::{is_behind, name_of_history, time_of};
use super::watch::Stream;
use super::{MongoDb, failure};
use crate::saturate::to_i64;
use crate::store::history::{HistoryRule, not_kept};
use crate::store::metadata::{INFO, INSERTED, UPDATED, info_path};
use crate::store::{Change, Changes, Find, Namespace, Next, Store as _, StoreError};

/// The collection that says since when the history of a collection is whole: `{_id, since}`.
const BEGINNINGS: &str = "rmem.histories";
/// How long one waits for one's own changes while no more of them come.
const OWN_TIMEOUT: Duration = Duration::from_secs(2);
/// How long one waits for them while only changes of others come.
const OTHERS_TIMEOUT: Duration = Duration::from_secs(10);
/// How long no change may come until the history counts as read to its end.
pub(super) const QUIET_TIME: Duration = Duration::from_millis(300);
/// How often a process that records all changes says how far it is, where none come.
const TELLING_INTERVAL: Duration = Duration::from_secs(1);
/// So many changes of others are recorded at once while one waits for one's own, at most.
const MOST_OF_OTHERS: u64 = 2_000;
/// Of so many documents it is known which entries are the last ones.
const MOST_KNOWN: usize = 100_000;

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
        // A date that was there before is that of an earlier change.
        let dated = |key: &str| {
            let path = |image: &str| format!("{image}.{}", info_path(key));
            vec![doc! { path("after"): at, path("before"): { "$ne": at } }, doc! { format!("dates.{key}"): at }]
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

/// A moment, by the server.
#[derive(Clone, Copy)]
pub(super) struct Moment {
    pub(super) time: DateTime,
    /// Behind the last change that it had.
    pub(super) position: Option<Timestamp>,
}

/// Which changes of a collection are to be recorded.
#[derive(Clone, Copy)]
pub(super) struct Part {
    /// How long no change may come until they count as read to their end.
    pub(super) lull: Duration,
    /// So many at most.
    pub(super) most: u64,
    /// Where nothing was recorded before: since when.
    pub(super) since: Option<Moment>,
    /// Those before a time of the server, where that is known.
    pub(super) until: Option<Timestamp>,
}

/// What was recorded of the changes of a collection.
#[derive(Default)]
pub(super) struct Caught {
    count: u64,
    /// Whether nothing is left of what was asked for.
    pub(super) is_whole: bool,
    /// Whether no more came, from a server that does not say up to when that is.
    pub(super) is_quiet: bool,
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
    pub(super) fn keeping(&self) -> std::sync::MutexGuard<'_, super::keeping::Keeping> {
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

    pub(super) fn rule(&self, ns: &Namespace) -> Option<HistoryRule> {
        HistoryRule::of(&self.keeping().rules, ns).cloned()
    }

    pub(super) fn entries(&self, ns: &Namespace) -> Collection<Document> {
        self.client().database(&ns.database).collection(ENTRIES)
    }

    pub(super) fn beginnings(&self, ns: &Namespace) -> Collection<Document> {
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
        let since = Instant::now();
        let start = self.moment()?;
        let mut owed = Owed::take(&self.address, ns);
        let recording = Recording::begin(self);
        let done = work();
        drop(recording);
        let made = made(done.as_ref());
        let may_be_made = matches!(done, Err(StoreError::Unreachable { may_be_done: true, .. }));
        if made.count > 0 || may_be_made {
            owed.push(self.signature(ns, &made, (start.time, since.elapsed()))?);
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

    /// How the changes of a write are signed that began at a time, and took so long at most.
    fn signature(&self, ns: &Namespace, made: &Made, (start, took): (DateTime, Duration)) -> Result<Owed, StoreError> {
        let start = start.timestamp_millis();
        let end = start.saturating_add(to_i64(took.as_millis())).saturating_add(1);
        // Changes of older servers have the time in seconds.
        let start = if self.takes_identities()? { start } else { start - start.rem_euclid(1_000) };
        let times = doc! { "$gte": DateTime::from_millis(start), "$lte": DateTime::from_millis(end) };
        let mut entries = made.filter.clone();
        entries.extend(doc! { "ns": ns.to_string(), "by": { "$exists": false }, "time": times });
        let keeping = self.keeping();
        let signature = doc! { "$set": { "by": &keeping.author, "run": keeping.run } };
        Ok(Owed { address: self.address.clone(), namespace: ns.clone(), entries, signature, is_exact: made.is_exact })
    }

    /// Makes the watch of a collection, before the first change that it is to record.
    fn begin(&self, ns: &Namespace) -> Result<(), StoreError> {
        if self.keeping().begun.contains(ns) {
            return Ok(());
        }
        let known = self.beginnings(ns).find_one(doc! { "_id": &ns.collection }).run().map_err(|e| self.explain(&e))?;
        let is_known = match self.follow_for_history(ns, &name_of_history(ns), None) {
            Ok(changes) => known.is_some() && !changes.is_new(),
            // Another process records at this moment.
            Err(StoreError::Held { .. }) => known.is_some(),
            Err(error) => return Err(error),
        };
        let since = if is_known { None } else { Some(self.moment()?.time) };
        self.begin_at(ns, since)?;
        self.keeping().begun.insert(ns.clone());
        Ok(())
    }

    /// Makes the indexes of entries, and where the history of a collection begins, notes that it is whole since a time.
    fn begin_at(&self, ns: &Namespace, since: Option<DateTime>) -> Result<(), StoreError> {
        if let Some(since) = since {
            let (own, set) = (doc! { "_id": &ns.collection }, doc! { "$max": { "since": since } });
            self.beginnings(ns).update_one(own, set).upsert(true).run().map_err(|e| self.explain(&e))?;
        }
        let indexes = [
            doc! { "key": { "ns": 1, "_id": 1 }, "name": "ns_1__id_1" },
            doc! { "key": { "ns": 1, "time": 1 }, "name": "ns_1_time_1" },
        ];
        let indexes = doc! { "createIndexes": ENTRIES, "indexes": indexes.to_vec() };
        self.client().database(&ns.database).run_command(indexes).run().map(drop).map_err(|e| self.explain(&e))
    }

    /// Now.
    pub(super) fn moment(&self) -> Result<Moment, StoreError> {
        let hello = self.hello().map_err(|e| self.explain(&e))?;
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
        let (begun, mut signed, mut is_read) = (Instant::now(), 0, false);
        let mut progress = begun;
        let mut part = Part { lull: Duration::from_millis(50), most: count, since: Some(start), until: end };
        while signed < count && !is_read && progress.elapsed() < OWN_TIMEOUT {
            // While another process records, one waits for it.
            let recorded = self.catch_up(ns, rule, part)?;
            if recorded.count == 0 {
                std::thread::sleep(Duration::from_millis(5));
            }
            // Where others write meanwhile, more and more is taken at once, so as to come by them.
            part.most = part.most.max((part.most * 2).min(MOST_OF_OTHERS));
            is_read = recorded.is_whole;
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

    /// Records a part of the changes, and their dates. While another process does so, nothing is recorded.
    pub(super) fn catch_up(&self, ns: &Namespace, rule: &HistoryRule, part: Part) -> Result<Caught, StoreError> {
        let since = part.since.and_then(|since| since.position);
        let followed = self.follow_for_history(ns, &name_of_history(ns), since);
        let caught = match followed.and_then(|changes| self.record_part(ns, changes, part)) {
            // Also where the database was dropped meanwhile.
            Err(StoreError::Held { .. }) => Caught::default(),
            caught => caught?,
        };
        if caught.count > 0 {
            self.bound(ns, rule)?;
        }
        Ok(caught)
    }

    fn record_part(
        &self,
        ns: &Namespace,
        mut changes: Stream<'_>,
        Part { lull, most, since, until }: Part,
    ) -> Result<Caught, StoreError> {
        if changes.is_new() {
            // The database was dropped, and the history with it.
            let since = since.map_or_else(|| self.moment(), Ok)?;
            self.begin_at(ns, Some(since.time))?;
        }
        let (mut caught, mut batch) = (Caught::default(), Batch::default());
        while caught.count < most && !caught.is_whole {
            let reached = match changes.next(lull)? {
                Next::Change(change) => {
                    batch.add(ns, &change)?;
                    time_of(&change.position)
                }
                Next::Nothing => match changes.take_date() {
                    Some(date) => {
                        self.date(ns, &date, &mut batch)?;
                        time_of(&date.position)
                    }
                    None => {
                        caught.is_whole = is_behind(changes.reached(), until);
                        caught.is_quiet = changes.reached().is_none();
                        break;
                    }
                },
                Next::Interrupted(_) => break,
            };
            caught.count += 1;
            caught.is_whole = is_behind(reached, until);
            if batch.is_full() {
                self.keep(ns, &mut batch, &mut changes)?;
            }
        }
        self.keep(ns, &mut batch, &mut changes)?;
        Ok(caught)
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
        if let Some(entry) = entry {
            batch.add_date(&entry, dated);
        }
        Ok(())
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

    /// Records what all clients change, until `stop`; returns how many changes.
    pub(super) fn record_all(
        &self,
        ns: &Namespace,
        stop: &AtomicBool,
        begun: &mut dyn FnMut(),
    ) -> Result<u64, StoreError> {
        let rule = self.rule(ns).ok_or_else(|| not_kept(ns, &[]))?;
        let (mut total, mut is_begun) = (0, false);
        while !stop.load(Ordering::Relaxed) {
            self.begin(ns)?;
            let changes = self.follow_for_history(ns, &name_of_history(ns), None)?;
            if !std::mem::replace(&mut is_begun, true) {
                begun();
            }
            match self.record_until(ns, &rule, changes, stop, &mut total) {
                // The database was dropped, and the history with it, or another process has taken over, which following says.
                Err(StoreError::Held { .. }) => self.keeping().begun.remove(ns),
                recorded => return recorded.map(|()| total),
            };
        }
        Ok(total)
    }

    fn record_until(
        &self,
        ns: &Namespace,
        rule: &HistoryRule,
        mut changes: Stream<'_>,
        stop: &AtomicBool,
        total: &mut u64,
    ) -> Result<(), StoreError> {
        let (mut looked, mut told, mut batch) = (Instant::now(), Instant::now(), Batch::default());
        while !stop.load(Ordering::Relaxed) {
            match changes.next(QUIET_TIME)? {
                Next::Change(change) => {
                    *total += 1;
                    batch.add(ns, &change)?;
                    self.keep(ns, &mut batch, &mut changes)?;
                }
                Next::Nothing => {
                    if let Some(date) = changes.take_date() {
                        self.date(ns, &date, &mut batch)?;
                        self.keep(ns, &mut batch, &mut changes)?;
                    } else if told.elapsed() >= TELLING_INTERVAL {
                        // Those who read the history wait for that.
                        changes.done()?;
                        told = Instant::now();
                    }
                }
                // The next call connects again.
                Next::Interrupted(_) => std::thread::sleep(QUIET_TIME),
            }
            if looked.elapsed() > Duration::from_secs(10) {
                self.bound(ns, rule)?;
                looked = Instant::now();
            }
        }
        changes.done()
    }
}

/// A time in milliseconds, from this one on, that was not given before.
fn next_time(from: i64) -> i64 {
    static LAST: AtomicI64 = AtomicI64::new(i64::MIN);
    let next = |last: i64| Some(from.max(last.saturating_add(1)));
    let last = LAST.fetch_update(Ordering::Relaxed, Ordering::Relaxed, next);
    next(last.unwrap_or_else(|last| last)).unwrap_or(from)
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
