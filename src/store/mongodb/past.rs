//! Reading the histories of a server (`history`), and letting go of what is too old or too much.

use std::collections::hash_map::Entry::Vacant;
use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};
use mongodb::sync::Collection;

use super::MongoDb;
use super::attempts::check_going_on;
use super::entry::{ENTRIES, id_key, is_computed, read};
use super::history::{Part, QUIET_TIME};
use super::position::is_behind;
use crate::query::key;
use crate::saturate::to_i64;
use crate::store::history::{History, HistoryRule, not_kept, too_old};
use crate::store::{ChangeKind, Documents, Find, Namespace, Store as _, StoreError};

/// The collection of the runs of which changes are not kept any more: `{_id: {ns, run}, at}`.
const CUT_RUNS: &str = "rmem.cut_runs";
/// How long one waits while another process records: longer than the lease of one that was lost.
const OTHERS_TIMEOUT: Duration = Duration::from_secs(20);

impl MongoDb {
    fn cut_runs(&self, ns: &Namespace) -> Collection<Document> {
        self.client().database(&ns.database).collection(CUT_RUNS)
    }

    /// Lets go of entries that are too old or too many.
    pub(super) fn bound(&self, ns: &Namespace, rule: &HistoryRule) -> Result<(), StoreError> {
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

    /// Records all changes that were made before; waits where another process does.
    fn catch_up_whole(&self, ns: &Namespace, rule: &HistoryRule) -> Result<(), StoreError> {
        let (begun, until) = (Instant::now(), self.moment()?.position);
        let part = Part { lull: QUIET_TIME, most: u64::MAX, since: None, until };
        while begun.elapsed() < OTHERS_TIMEOUT {
            let caught = self.catch_up(ns, rule, part)?;
            if caught.is_whole || caught.is_quiet || until.is_none() || is_behind(self.recorded_until(ns)?, until) {
                return Ok(());
            }
            check_going_on(0)?;
            std::thread::sleep(Duration::from_millis(10));
        }
        let what = format!("another process records the changes of {ns}, and is behind; try again");
        Err(StoreError::Held { what })
    }

    pub(super) fn past(&self, ns: &Namespace, after: Option<DateTime>) -> Result<Option<History<'_>>, StoreError> {
        let Some(since) = self.beginning(ns)? else { return Ok(None) };
        if let Some(rule) = self.rule(ns) {
            self.catch_up_whole(ns, &rule)?;
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
}
