//! The operations of [`Store`], each in a few lines.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Instant;

use bson::{DateTime, Document, RawDocument, RawDocumentBuf, rawdoc};

use super::catalog::Collection;
use super::change_log::Noted;
use super::indexed::decay;
use super::snapshot::Snapshot;
use super::{Embedded, busy, catalog_cache, failure, file};
use crate::monotonic;
use crate::query::collation::during;
use crate::query::{Collation, QueryError};
use crate::saturate::to_i64;
use crate::store::validation::During;
use crate::store::{
    Aggregation, ChangePage, Changes, Checked, Choose, Documents, Find, FindAndModify, History, HistoryRule, Index,
    IndexChange, Inserted, Kept, Modified, Name, Namespace, NotedChanges, Put, Query, Scope, Since, Store, StoreError,
    UpdateRequest, Updated, Validated, Validation, Values, Warn,
};

/// MongoDB's code for a write that another one has overtaken.
const WRITE_CONFLICT: i32 = 112;
/// Pages that no statement uses are given back to the system.
const FREE_CACHE: &str = "PRAGMA shrink_memory";
/// Why a write was rolled back, where no error was seen.
const UNSEEN: &str = "reading or writing failed, and nothing of this write was kept; check the disk, and repeat";

impl Store for Embedded {
    fn insert(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        self.insert_batch(ns, documents)
    }

    fn put(&self, ns: &Namespace, documents: Vec<Document>, timestamp: Option<DateTime>) -> Result<Put, StoreError> {
        self.put_all(ns, documents, timestamp)
    }

    fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        self.find_at(self.moment()?, ns, find)
    }

    fn find_chosen<'f>(&self, ns: &Namespace, choose: Choose<'_, 'f>) -> Result<Option<Documents<'_>>, StoreError> {
        let moment = self.moment()?;
        let indexes = self.collection(ns)?.map(|collection| self.indexes_of(collection)).transpose()?;
        // What is computed decays, too.
        let is_lasting = indexes.is_none_or(|indexes| decay(&indexes).is_none());
        choose(is_lasting)?.map(|find| self.find_at(moment, ns, &find)).transpose()
    }

    fn explain(&self, ns: &Namespace, find: &Find) -> Result<Document, StoreError> {
        self.explained(ns, find)
    }

    fn count(&self, ns: &Namespace, query: Query<'_>) -> Result<u64, StoreError> {
        self.tally(ns, query)
    }

    fn values(&self, ns: &Namespace, field: &str, query: Query<'_>) -> Result<Values, StoreError> {
        self.distinct_values(ns, field, query)
    }

    fn aggregate(&self, ns: &Namespace, pipeline: Aggregation<'_>) -> Result<Documents<'_>, StoreError> {
        let collation = self.collation(self.collection(ns)?, pipeline.modifiers)?;
        Ok(collated(during(collation.as_ref(), || self.run_pipeline(ns, pipeline))?, collation))
    }

    fn update(
        &self,
        ns: &Namespace,
        update: &UpdateRequest,
        timestamp: Option<DateTime>,
    ) -> Result<Updated, StoreError> {
        let collation = self.collation(self.collection(ns)?, &update.modifiers)?;
        during(collation.as_ref(), || self.change(ns, update, timestamp))
    }

    fn delete(&self, ns: &Namespace, query: Query<'_>, first_only: bool) -> Result<u64, StoreError> {
        let _deleting = self.deleting();
        let collation = self.collation(self.collection(ns)?, query.modifiers)?;
        during(collation.as_ref(), || self.remove(ns, query, first_only))
    }

    fn drop(&self, ns: &Namespace) -> Result<bool, StoreError> {
        let _deleting = self.deleting();
        self.write(|| match self.collection(ns)? {
            Some(collection) => {
                self.note_drop(ns, collection, None)?;
                self.erase_collection(collection).map(|()| true)
            }
            None => Ok(false),
        })
    }

    fn note_dropped(&self, database: &str) -> Result<(), StoreError> {
        self.write(|| self.note_drop_database(database))
    }

    fn find_and_modify(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        timestamp: Option<DateTime>,
    ) -> Result<Modified, StoreError> {
        self.modify_first(ns, request, timestamp)
    }

    fn rename(&self, from: &Namespace, to: &Namespace, drop_target: bool) -> Result<(), StoreError> {
        let names = rawdoc! { "db": &*to.database, "from": &*from.collection, "to": &*to.collection };
        // No stream hears of a collection of rmem's own.
        let names = (!from.is_own()).then_some(&*names);
        self.write(|| {
            if !drop_target && self.collection(to)?.is_some() {
                let message = format!("{to} exists already");
                return Err(QueryError::invalid(QueryError::NAMESPACE_EXISTS, message).into());
            }
            self.take_name(from, to, names)?;
            names.map_or(Ok(()), |names| self.note_names(from, to, names))
        })
    }

    fn create_index(&self, ns: &Namespace, index: &Index) -> Result<bool, StoreError> {
        self.create(ns, index)
    }

    fn check_index(&self, index: &Index) -> Result<(), StoreError> {
        Ok(super::index::check(index)?)
    }

    fn drop_index(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        self.discard(ns, name)
    }

    fn modify_index(&self, ns: &Namespace, name: &str, change: IndexChange) -> Result<bool, StoreError> {
        self.change_index(ns, name, change)
    }

    fn indexes(&self, ns: &Namespace) -> Result<Vec<Index>, StoreError> {
        self.list_indexes(ns)
    }

    fn collections(&self) -> Result<Vec<Namespace>, StoreError> {
        Collection::all(&self.connection).map_err(|e| self.explain(&e))
    }

    fn watch(&self, ns: &Namespace, name: Option<&str>) -> Result<Box<dyn Changes + '_>, StoreError> {
        self.follow(ns, name)
    }

    fn forget(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        let _deleting = self.deleting();
        self.forget_name(ns, name)
    }

    fn names(&self) -> Result<Vec<Name>, StoreError> {
        self.watch_names()
    }

    fn create(&self, ns: &Namespace, collation: Option<&Collation>) -> Result<bool, StoreError> {
        self.create_collection(ns, collation)
    }

    fn validation(&self, ns: &Namespace) -> Result<Option<Validation>, StoreError> {
        self.validation_of(ns)
    }

    fn set_validation(&self, ns: &Namespace, validation: &Validation) -> Result<(), StoreError> {
        self.change_validation(ns, validation)
    }

    fn unvalidated(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        let _bypassing = During::begin(&self.is_bypassing);
        work()
    }

    fn warn_by(&self, warn: Warn) {
        self.warn.replace(Some(warn));
    }

    fn keep_changes(&self, scope: &Scope, since: DateTime) -> Result<Kept, StoreError> {
        self.retain(scope, since)
    }

    fn release_changes(&self, scope: &Scope) -> Result<(), StoreError> {
        let _deleting = self.deleting();
        self.release(scope)
    }

    fn kept_scopes(&self) -> Result<Vec<Scope>, StoreError> {
        self.retained()
    }

    fn changes(&self, scope: &Scope, behind: i64, most: usize) -> Result<ChangePage, StoreError> {
        self.changes_behind(scope, behind, most)
    }

    fn noted_changes(&self) -> Result<Option<NotedChanges>, StoreError> {
        self.noted()
    }

    fn committed_changes(&self) -> Result<Option<NotedChanges>, StoreError> {
        self.committed()
    }

    fn join_changes(&self) -> Result<Option<NotedChanges>, StoreError> {
        self.joined(monotonic::now())
    }

    fn position_at(&self, scope: &Scope, time: DateTime) -> Result<Since, StoreError> {
        self.before(scope, time)
    }

    fn keep_history(&self, rules: &[HistoryRule]) {
        self.log.keeping.rules.replace(rules.to_vec());
    }

    fn sign(&self, author: &str) {
        self.log.keeping.sign(author);
    }

    fn history(&self, ns: &Namespace, after: Option<DateTime>) -> Result<Option<History<'_>>, StoreError> {
        self.past(ns, after)
    }

    fn as_of(&self, ns: &Namespace, at: DateTime) -> Result<Vec<RawDocumentBuf>, StoreError> {
        self.rewound(ns, at)
    }

    fn changed_collections(&self) -> Result<Vec<Namespace>, StoreError> {
        self.list_changed()
    }

    fn limit_cache(&self, bytes: usize) -> Result<(), StoreError> {
        // A negative number is one of kibibytes.
        let kibibytes = to_i64(bytes / 1024);
        self.connection.pragma_update(None, "cache_size", -kibibytes).map_err(|e| self.explain(&e))
    }

    fn free_cache(&self) {
        // What cannot be freed now is in use.
        let _ = self.connection.execute_batch(FREE_CACHE);
    }

    fn number(&self, ns: &Namespace) -> Result<Option<i64>, StoreError> {
        Ok(self.collection(ns)?.map(|collection| collection.id))
    }

    fn check_whole(&self, ns: &Namespace) -> Result<(), StoreError> {
        let Some(collection) = self.collection(ns)? else { return Ok(()) };
        self.check_count(collection)
    }

    fn fold(&self) -> Result<(), StoreError> {
        let fold = "PRAGMA wal_checkpoint(TRUNCATE)";
        self.connection.query_row(fold, [], |_| Ok(())).map_err(|e| self.explain(&e))
    }

    fn atomically(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        self.write(work)
    }

    fn is_rolled_back(&self) -> bool {
        self.rolled_back().is_some()
    }

    fn at_one_moment(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<bool, StoreError> {
        let before = {
            let _moment = self.moment()?;
            let version = self.version().map_err(|e| self.explain(&e))?;
            let _reading = During::begin(&self.is_reading);
            work().map(|()| version)?
        };
        Ok(self.version().map_err(|e| self.explain(&e))? == before)
    }

    fn state(&self) -> Option<(i64, u64)> {
        self.catalog_cache.state()
    }

    fn reading_until(
        &self,
        until: Instant,
        work: &mut dyn FnMut() -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        self.reads_until.set(Some(until));
        let result = work();
        self.reads_until.set(None);
        result
    }

    fn unflushed(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        // A transaction is as durable as where it was begun.
        if !self.connection.is_autocommit() {
            return work();
        }
        file::be_durable(&self.connection, false).map_err(|e| self.explain(&e))?;
        let result = work();
        let durable = file::be_durable(&self.connection, true).map_err(|e| self.explain(&e));
        result.and(durable)
    }

    fn takes_any(&self, ns: &Namespace) -> Result<bool, StoreError> {
        self.is_unconstrained(ns)
    }

    fn is_atomic(&self) -> bool {
        true
    }

    fn check(&self, report: &mut dyn FnMut(&str)) -> Result<Option<Checked>, StoreError> {
        self.check_all(report).map(Some)
    }

    fn validate(&self, ns: &Namespace, report: &mut dyn FnMut(&str)) -> Result<Option<Validated>, StoreError> {
        self.validated(ns, report)
    }

    fn index_sizes(&self, ns: &Namespace) -> Result<Vec<(String, i64)>, StoreError> {
        self.collection(ns)?.map_or(Ok(Vec::new()), |collection| self.sizes(collection))
    }

    fn backup(&self, path: &Path) -> Result<(), StoreError> {
        self.copy_to(path)
    }

    fn describe(&self) -> String {
        self.place.to_string()
    }
}

/// Documents that are computed with the collation of their operation in effect.
pub(super) fn collated(mut documents: Documents<'_>, collation: Option<Collation>) -> Documents<'_> {
    match collation {
        None => documents,
        Some(collation) => Box::new(std::iter::from_fn(move || during(Some(&collation), || documents.next()))),
    }
}

impl Embedded {
    /// A moment at which several things are read.
    fn moment(&self) -> Result<Snapshot<'_>, StoreError> {
        Snapshot::knowing(&self.connection, &self.catalog_cache).map_err(|e| self.explain(&e))
    }

    /// A number that changes with what others write.
    fn version(&self) -> rusqlite::Result<i64> {
        catalog_cache::version(&self.connection)
    }

    fn find_at(&self, moment: Snapshot<'_>, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        self.answer(moment, ns, find)
    }

    /// Runs `work` in a write transaction: all of it is kept, or, where it fails, nothing.
    /// Within [`Store::atomically`] there is one already, of which it is a step.
    pub(super) fn write<T>(&self, work: impl FnOnce() -> Result<T, StoreError>) -> Result<T, StoreError> {
        if self.is_reading.get() {
            return Err(QueryError::invalid(WRITE_CONFLICT, "what is read at one moment cannot be written to").into());
        }
        self.catalog_cache.count_write();
        if let Some(error) = self.rolled_back() {
            return Err(error);
        }
        if !self.connection.is_autocommit() {
            return self.step(work);
        }
        self.make_room()?;
        self.run("BEGIN IMMEDIATE").map_err(|e| self.explain(&e))?;
        self.finish(work)
    }

    /// Runs a part of a write transaction; where it fails, it alone is taken back.
    fn step<T>(&self, work: impl FnOnce() -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.run("SAVEPOINT step").map_err(|e| self.explain(&e))?;
        let step = Step(self);
        let result = work();
        drop(step);
        let rolled_back = self.rolled_back();
        if result.is_err() || rolled_back.is_some() {
            self.indexes.clear();
            self.catalog_cache.forget();
        }
        if let Some(error) = rolled_back {
            // There are no savepoints any more.
            return Err(error);
        }
        if result.is_err() {
            // Where that fails, the error of the work is returned all the same.
            let _ = self.run("ROLLBACK TO step");
        }
        let released = self.run("RELEASE step");
        result.and_then(|value| released.map(|()| value).map_err(|e| self.explain(&e)))
    }

    /// The same, where no other process is writing (else nothing, soon), for what may be lost
    /// with the power: it does not wait for the disk.
    pub(super) fn write_soon<T>(&self, work: impl FnOnce() -> Result<T, StoreError>) -> Result<Option<T>, StoreError> {
        if !self.connection.is_autocommit() || self.is_rolled_back() {
            return Ok(None);
        }
        self.catalog_cache.count_write();
        file::be_durable(&self.connection, false).map_err(|e| self.explain(&e))?;
        self.is_brief.store(true, Ordering::Relaxed);
        let begun = self.run("BEGIN IMMEDIATE");
        self.is_brief.store(false, Ordering::Relaxed);
        let written = match begun {
            Ok(()) => self.finish(work).map(Some),
            Err(error) if busy::is_busy(&error) => Ok(None),
            Err(error) => Err(self.explain(&error)),
        };
        file::be_durable(&self.connection, true).map_err(|e| self.explain(&e))?;
        written
    }

    fn finish<T>(&self, work: impl FnOnce() -> Result<T, StoreError>) -> Result<T, StoreError> {
        let log = self.place.log();
        log.iter().for_each(|log| self.log_size.extend(log));
        let open =
            || self.catalog_cache.open(&self.connection).map_err(|e| self.explain(&e)).and_then(|()| self.open_log());
        self.rolled_back.begin();
        let result = open().and_then(|()| work()).and_then(|value| {
            self.rolled_back().map_or(Ok(()), Err)?;
            self.bound_log()?;
            self.keep_room()?;
            self.run("COMMIT").map(|()| value).map_err(|e| self.explain(&e))
        });
        self.catalog_cache.close();
        let result = match (result, self.rolled_back.end(&self.place)) {
            (Err(_), Some(cause)) => Err(cause),
            (result, _) => result,
        };
        if result.is_ok() {
            log.iter().for_each(|log| self.log_size.measure(log));
            self.publish_log();
        } else if !self.connection.is_autocommit() {
            // A failing rollback leaves nothing to do: closing rolls back too.
            let _ = self.run("ROLLBACK");
        }
        if let Err(error) = &result {
            self.indexes.clear();
            self.catalog_cache.forget();
            self.log.keeping.forget();
            if let StoreError::DiskFull { .. } = error {
                // The log is folded into the file and cut, so that there is room to delete something.
                let _ = self.fold();
                return Err(match self.is_deleting() {
                    true => failure::no_room_to_delete(&self.place),
                    false => failure::disk_full(&self.place),
                });
            }
        }
        result
    }

    /// Why SQLite has rolled back the write that is being done, where it has.
    fn rolled_back(&self) -> Option<StoreError> {
        if self.rolled_back.is_writing() && self.connection.is_autocommit() {
            self.rolled_back.note(&self.fail(UNSEEN));
        }
        self.rolled_back.error(&self.place)
    }

    /// Gives a collection another name, in place of one that has it. `names` are as in [`Embedded::note_drop`]. In a write
    /// transaction only.
    pub(super) fn take_name(
        &self,
        from: &Namespace,
        to: &Namespace,
        names: Option<&RawDocument>,
    ) -> Result<(), StoreError> {
        let Some(collection) = self.collection(from)? else {
            let message = format!("there is no collection {from} to be renamed");
            return Err(QueryError::invalid(QueryError::NAMESPACE_NOT_FOUND, message).into());
        };
        match self.collection(to)? {
            Some(present) if present == collection => return Ok(()),
            Some(present) => {
                self.note_drop(to, present, names)?;
                self.erase_collection(present)?;
            }
            None => self.note(to, Noted::drop(None).by_rename(names))?,
        }
        self.note_rename(collection, (from, to), names)?;
        self.catalog_cache.forget();
        collection.rename(&self.connection, to).map_err(|e| self.explain(&e))
    }

    /// Removes a collection with its indexes. In a write transaction only.
    pub(super) fn erase_collection(&self, collection: Collection) -> Result<(), StoreError> {
        self.forget_validation(collection)?;
        self.forget_indexes(collection)?;
        self.catalog_cache.forget();
        collection.drop(&self.connection).map_err(|e| self.explain(&e))
    }

    fn run(&self, sql: &str) -> rusqlite::Result<()> {
        self.connection.prepare_cached(sql).and_then(|mut statement| statement.execute([])).map(|_| ())
    }

    /// The collection of a name, created where there is none. In a write transaction only.
    pub(super) fn ensure(&self, ns: &Namespace) -> Result<Collection, StoreError> {
        self.catalog_cache.ensure(&self.connection, ns).map_err(|e| self.explain(&e))
    }

    pub(super) fn collection(&self, ns: &Namespace) -> Result<Option<Collection>, StoreError> {
        self.catalog_cache.find(&self.connection, ns).map_err(|e| self.explain(&e))
    }

    pub(super) fn explain(&self, error: &rusqlite::Error) -> StoreError {
        if failure::is_damage(error) {
            // SQLite checks a page when it is read: a damaged one that stays in memory is not checked again.
            let _ = self.connection.execute_batch(FREE_CACHE);
        }
        let explained = failure::explain(&self.place, error);
        if self.rolled_back.is_writing() && self.connection.is_autocommit() {
            self.rolled_back.note(&explained);
        }
        explained
    }

    pub(super) fn fail(&self, reason: &str) -> StoreError {
        StoreError::Failed { address: self.place.to_string(), reason: reason.to_owned() }
    }
}

/// A part of a write transaction, of which nothing is kept where it panics.
struct Step<'a>(&'a Embedded);

impl Drop for Step<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() && !self.0.connection.is_autocommit() {
            let _ = self.0.run("ROLLBACK TO step").and_then(|()| self.0.run("RELEASE step"));
            self.0.indexes.clear();
            self.0.catalog_cache.forget();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::UpdateSpec;
    use bson::doc;
    use std::borrow::Cow;
    use std::time::Duration;

    #[test]
    fn only_what_is_unflushed_does_not_wait_for_the_disk() {
        let folder = tempfile::tempdir().unwrap();
        let store = Embedded::open(folder.path().join("robot.rmem")).unwrap();
        let ns = Namespace::parse("a.b").unwrap();
        let waits = |store: &Embedded| store.connection.query_row("PRAGMA synchronous", [], |row| row.get::<_, i64>(0));
        let (normal, full) = (Ok(1), Ok(2));
        assert_eq!(waits(&store), full);
        let failing = store.unflushed(&mut || {
            assert_eq!(waits(&store), normal);
            store.atomically(&mut || store.insert(&ns, vec![doc! { "_id": 1 }]).map(drop))?;
            store.insert(&ns, vec![doc! { "_id": 1 }]).map(drop)
        });
        assert!(matches!(failing, Err(StoreError::Duplicate { .. })));
        assert_eq!(waits(&store), full);
        // A transaction that waits for the disk goes on doing so.
        let within = store.atomically(&mut || {
            store.unflushed(&mut || {
                assert_eq!(waits(&store), full);
                store.insert(&ns, vec![doc! { "_id": 2 }]).map(drop)
            })
        });
        assert!(within.is_ok());
        assert_eq!(store.count(&ns, (&doc! {}).into()).unwrap(), 2);
    }

    #[test]
    fn nothing_stays_of_what_is_done_as_one_where_the_disk_is_full() {
        let folder = tempfile::tempdir().unwrap();
        let store = Embedded::open(folder.path().join("robot.rmem")).unwrap();
        let (ns, made) = (Namespace::parse("a.b").unwrap(), Namespace::parse("a.made").unwrap());
        store.insert(&ns, vec![doc! { "_id": 0, "n": 0 }]).unwrap();
        let update = UpdateSpec::Document(doc! { "$inc": { "n": 1 } });
        let request = UpdateRequest { filter: doc! { "_id": 0 }, update, ..UpdateRequest::default() };
        let fill = || store.insert(&made, vec![doc! { "text": "x".repeat(1 << 20) }]);
        let limit = |pages: i64| store.connection.pragma_update(None, "max_page_count", pages);
        let pages = store.connection.query_row("PRAGMA page_count", [], |row| row.get::<_, i64>(0)).unwrap();
        limit(pages + 20).unwrap();
        let fails = |result: Result<(), StoreError>| matches!(result, Err(StoreError::DiskFull { .. }));
        let mut begun = 0;
        let done = store.atomically(&mut || {
            store.update(&ns, &request, None)?;
            assert!(!store.is_rolled_back());
            assert!(fails(store.atomically(&mut || {
                assert!(fails(fill().map(drop)));
                assert!(store.connection.is_autocommit(), "SQLite has rolled back all");
                // A step does not know that the others are lost.
                Ok(())
            })));
            assert!(store.is_rolled_back());
            assert!(fails(store.update(&ns, &request, None).map(drop)));
            assert_eq!(store.count(&ns, (&doc! { "n": 0 }).into())?, 1);
            assert!(fails(store.atomically(&mut || {
                begun += 1;
                Ok(())
            })));
            assert_eq!(store.write_soon(|| Ok(()))?, None);
            Ok(())
        });
        assert!(fails(done));
        assert_eq!(begun, 0);
        assert!(!store.is_rolled_back());
        assert_eq!(store.count(&ns, (&doc! { "n": 0 }).into()).unwrap(), 1);
        // One that fails by itself is no other.
        assert!(fails(fill().map(drop)));
        limit(i64::from(i32::MAX)).unwrap();
        store.update(&ns, &request, None).unwrap();
        fill().unwrap();
        let count = |ns: &Namespace, filter: Document| store.count(ns, (&filter).into()).unwrap();
        assert_eq!((count(&ns, doc! { "n": 1 }), count(&made, doc! {})), (1, 1));
    }

    #[test]
    fn what_chooses_a_query_and_its_answer_are_of_one_moment() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let (store, other) = (Embedded::open(&path).unwrap(), Embedded::open(&path).unwrap());
        let ns = Namespace::parse("a.b").unwrap();
        store.insert(&ns, vec![doc! { "_id": 1 }]).unwrap();
        let found = store.find_chosen(&ns, &mut |_| {
            assert_eq!(store.count(&ns, (&doc! {}).into())?, 1);
            other.insert(&ns, vec![doc! { "_id": 2 }])?;
            Ok(Some(Cow::Owned(Find::default())))
        });
        assert_eq!(found.unwrap().unwrap().count(), 1);
        assert!(store.connection.is_autocommit(), "the moment is over");
        assert_eq!(store.find(&ns, &Find::default()).unwrap().count(), 2);
        assert!(store.find_chosen(&ns, &mut |_| Ok(None)).unwrap().is_none());
        assert!(store.connection.is_autocommit());
    }

    #[test]
    fn what_reads_too_long_is_given_up_and_nothing_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let store = Embedded::open(folder.path().join("robot.rmem")).unwrap();
        let ns = Namespace::parse("a.b").unwrap();
        store.insert(&ns, vec![doc! { "_id": 1 }, doc! { "_id": 2 }]).unwrap();
        let count = |limit: Duration| {
            let mut counted = 0;
            let done = store.atomically(&mut || {
                store.insert(&ns, vec![doc! { "_id": 3 }])?;
                store.reading_until(Instant::now() + limit, &mut || {
                    counted = store.count(&ns, (&doc! { "_id": { "$gt": 1 } }).into())?;
                    Ok(())
                })
            });
            done.map(|()| counted)
        };
        assert!(matches!(count(Duration::ZERO), Err(StoreError::Held { .. })));
        assert_eq!(store.find(&ns, &Find::default()).unwrap().count(), 2, "it is read without a limit behind that");
        assert_eq!(count(Duration::from_secs(600)).unwrap(), 2);
    }

    #[test]
    fn nothing_is_kept_of_a_part_of_a_write_that_panics() {
        let store = Embedded::in_memory().unwrap();
        let ns = Namespace::parse("a.b").unwrap();
        let insert = |id: i32| store.insert(&ns, vec![doc! { "_id": id }]).map(drop);
        let caught = |work: &mut dyn FnMut()| std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).is_err();
        store
            .atomically(&mut || {
                insert(1)?;
                let has_panicked = caught(&mut || {
                    let _ = store.atomically(&mut || {
                        insert(2)?;
                        store.atomically(&mut || {
                            insert(3)?;
                            panic!("a mistake")
                        })
                    });
                });
                assert!(has_panicked);
                insert(4)
            })
            .unwrap();
        let found = store.find(&ns, &Find::default()).unwrap();
        let ids: Vec<i32> = found.map(|found| found.unwrap().get_i32("_id").unwrap()).collect();
        assert_eq!(ids, [1, 4]);
    }
}
