//! The operations, each on the store its namespace belongs to.

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Instant;

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::clock::Clock;
use super::computables::{self, Answering, Computables, Computed, Registry, View};
use super::hidden_metadata;
use super::journal::{Journal, Observer};
use super::route::{Lazy, Routes};
use crate::query::QueryError;
use crate::saturate::to_i64;
use crate::store::{
    Aggregation, Documents, Find, Inserted, Namespace, Put, Query, Role, Store, StoreError, StoreUri, UpdateRequest,
    Updated, Values, Warn, metadata,
};

/// A local store and, perhaps, another one for shared databases.
pub struct Memory {
    pub(super) routes: Routes,
    pub(super) clock: Clock,
    pub(super) journal: Journal,
    pub(super) computables: Box<Computables>,
}

impl Memory {
    /// A memory over one store, or over two with databases named that go to `shared`.
    #[must_use]
    pub fn new(local: Box<dyn Store>, shared: Option<Box<dyn Store>>, shared_databases: Vec<String>) -> Self {
        let routes = Routes::new(Lazy::open(local), shared.map(Lazy::open), shared_databases);
        Self { routes, clock: Clock::System, journal: Journal::default(), computables: Box::default() }
    }

    /// A memory over the stores at these addresses. Each is opened by the
    /// first operation that needs it; equal addresses are one store.
    #[must_use]
    pub fn at(local: StoreUri, shared: StoreUri, shared_databases: Vec<String>) -> Self {
        let shared = (local != shared).then(|| Lazy::at(shared, Role::Shared));
        let routes = Routes::new(Lazy::at(local, Role::Local), shared, shared_databases);
        Self { routes, clock: Clock::System, journal: Journal::default(), computables: Box::default() }
    }

    /// The same memory with another clock.
    #[must_use]
    pub fn with_clock(self, clock: Clock) -> Self {
        Self { clock, ..self }
    }

    /// The same memory, which calls `observer` with each operation as it ends.
    #[must_use]
    pub fn with_observer(self, observer: Observer) -> Self {
        Self { journal: self.journal.clone().observed_by(observer), ..self }
    }

    /// The same memory, which counts the documents that it stores, or reads to be written elsewhere.
    #[must_use]
    pub fn with_meter(self, meter: Arc<AtomicU64>) -> Self {
        Self { journal: self.journal.clone().counting(meter), ..self }
    }

    /// The same memory, where reading from a file that does not exist is an error, and not an
    /// empty memory: the path may be mistyped.
    #[must_use]
    pub fn expecting_files(self) -> Self {
        self.routes.expect();
        self
    }

    /// The store of a collection.
    pub(super) fn store(&self, ns: &Namespace) -> Result<&dyn Store, StoreError> {
        self.routes.of(ns)
    }

    /// What the stores are, for `-v` and `doctor`; opens nothing, never shows credentials.
    #[must_use]
    pub fn describe(&self) -> String {
        self.routes.describe()
    }

    /// What the private store is; see [`Memory::describe`].
    #[must_use]
    pub fn describe_private(&self) -> String {
        self.routes.describe_private()
    }

    /// Which databases are in a shared store beside it, and what that is, where there is one.
    #[must_use]
    pub fn describe_shared(&self) -> Option<String> {
        self.routes.describe_shared()
    }

    /// Stores documents; see [`Store::insert`].
    pub fn insert(&self, ns: &Namespace, mut documents: Vec<Document>) -> Result<Inserted, StoreError> {
        let (now, count) = (self.clock.now(), documents.len());
        let prepare = |document: &mut Document| -> Result<(), StoreError> {
            self.check_kept(ns, std::slice::from_ref(document))?;
            Ok(metadata::insert(document, now)?)
        };
        let refused =
            documents.iter_mut().enumerate().find_map(|(nth, document)| Some((nth, prepare(document).err()?)));
        let Some((acceptable, refusal)) = refused else { return self.insert_checked(ns, documents) };
        documents.truncate(acceptable);
        let stored = if documents.is_empty() { Vec::new() } else { self.insert_checked(ns, documents)?.ids };
        Err(refusal.stopped(stored, count))
    }

    fn insert_checked(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        self.journal
            .note(
                "insert",
                Some(ns),
                |inserted: &Inserted| length(&inserted.ids),
                || self.routes.of(ns)?.insert(ns, documents),
            )
            .inspect(|inserted| self.journal.count(length(&inserted.ids)))
    }

    /// Opens the file that a collection is in before something is done there. Where that fails, the
    /// operation fails again. A server is not contacted: it may take long to answer.
    pub fn prepare(&self, ns: &Namespace) {
        if self.routes.is_in_file(ns) {
            let _ = self.routes.reading(ns).and_then(|store| store.indexes(ns));
        }
    }

    /// Whether a collection is in a file of this machine, so that work on it is done in this process.
    #[must_use]
    pub fn is_in_file(&self, ns: &Namespace) -> bool {
        self.routes.is_in_file(ns)
    }

    /// Stores documents in place of those with their `_id`s; see [`Store::put`].
    pub fn put(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Put, StoreError> {
        let count = length(&documents);
        documents.iter().try_for_each(metadata::check)?;
        self.check_kept(ns, &documents)?;
        let put = || self.routes.of(ns)?.put(ns, documents, Some(self.clock.now()));
        self.journal.note("put", Some(ns), |_| count, put).inspect(|_| self.journal.count(count))
    }

    /// Answers a query with documents as applications see them: without
    /// metadata, unless the projection names some. See [`Store::find`].
    pub fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        let (documents, has_hidden) = self.find_to_hide(ns, find)?;
        Ok(if has_hidden { without_metadata(documents) } else { documents })
    }

    /// The same documents, perhaps with metadata that is to be hidden, and whether it is: for readers that look at single
    /// fields, and pass over it.
    pub(crate) fn find_to_hide(&self, ns: &Namespace, find: &Find) -> Result<(Documents<'_>, bool), StoreError> {
        let documents = self.find_with_metadata(ns, &hidden_metadata::in_find(find))?;
        Ok((documents, has_hidden(&find.projection)))
    }

    /// Answers a query with documents and their metadata.
    pub fn find_with_metadata(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        let _operation = self.computables.operate();
        if let Some(found) = self.find_stored(ns, find)? {
            return Ok(found);
        }
        self.check_keys(ns, find)?;
        self.answer(&[(ns, &find.filter)], Answering::Reading, |view| {
            if let Some(extended) = self.extended(&[(ns, &find.filter)], &find.modifiers, view)? {
                let find = find.with_filter(hidden_metadata::in_filter(&find.filter));
                return Ok(ready(extended.find(ns, &find)?));
            }
            let start = Instant::now();
            let find = find.with_filter(view.filter(&find.filter));
            settled(view, self.journal.watch("find", ns, start, self.read(ns, &find, view)?))
        })
    }

    /// Answers a query that needs no computables, which is read together with the documents; else gives nothing.
    fn find_stored(&self, ns: &Namespace, find: &Find) -> Result<Option<Documents<'_>>, StoreError> {
        if self.has_once() {
            return Ok(None);
        }
        let Some(store) = self.routes.existing(ns)? else { return Ok(None) };
        let (start, view) = (Instant::now(), self.computables.view(self.clock.now()));
        let found = store.find_chosen(ns, &mut |is_lasting| {
            let is_plain = self.needed(ns, &find.filter)?.is_empty();
            Ok(is_plain.then(|| match is_lasting {
                true => hidden_metadata::in_filter_of(find),
                false => Cow::Owned(find.with_filter(view.filter(&find.filter))),
            }))
        })?;
        let Some(found) = found else { return Ok(None) };
        self.computables.forget_last();
        settled(&view, self.journal.watch("find", ns, start, found)).map(Some)
    }

    /// Refuses to ask an index for its keys, or documents for their places, where some of the documents are computed: those
    /// may be in no index.
    fn check_keys(&self, ns: &Namespace, find: &Find) -> Result<(), StoreError> {
        if find.keys.is_empty() || self.needed(ns, &find.filter)?.is_empty() && !self.has_once() {
            return Ok(());
        }
        Err(QueryError::unsupported("min, max, returnKey or showRecordId, where documents are computed,").into())
    }

    /// Documents as they are stored, with their metadata: nothing is computed, and what was
    /// computed is left out.
    pub fn stored(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        let start = Instant::now();
        let find = find.with_filter(stored(self.clock.now(), &find.filter));
        let found = self.journal.watch("find", ns, start, self.routes.reading(ns)?.find(ns, &find)?);
        Ok(self.journal.counted(found))
    }

    /// Counts the matches of [`Memory::stored`].
    pub fn count_stored(&self, ns: &Namespace, filter: &Document) -> Result<u64, StoreError> {
        let filter = stored(self.clock.now(), filter);
        self.journal.note("count", Some(ns), |count| *count, || self.routes.reading(ns)?.count(ns, (&filter).into()))
    }

    /// Says how a query is answered; see [`Store::explain`]. Where there are computables, those
    /// that the query needs run, and `computables` says what they did.
    pub fn explain(&self, ns: &Namespace, find: &Find) -> Result<Document, StoreError> {
        self.check_keys(ns, find)?;
        let mut explanation = self.answer(&[(ns, &find.filter)], Answering::Asking, |view| {
            let chosen = self.choosing(ns, &find.filter, view)?;
            if let (Some(extended), Some(chosen)) =
                (self.extended(&[(ns, &find.filter)], &find.modifiers, view)?, chosen)
            {
                // The store chooses the documents; the query is answered, and sorted, over a copy with the added keys.
                let modifiers = find.modifiers.without_hint();
                let choose = Find { filter: chosen, modifiers, ..Find::default() };
                let mut explanation = self.routes.reading(ns)?.explain(ns, &choose)?;
                let returned = extended.find(ns, find)?;
                explanation.insert("returned", to_i64(returned.len()));
                if !find.sort.is_empty() {
                    explanation.insert("sort", "memory");
                }
                return Ok(explanation);
            }
            let find = find.with_filter(view.filter(&find.filter));
            self.journal.note("explain", Some(ns), |_| 1, || self.routes.reading(ns)?.explain(ns, &find))
        })?;
        if self.registry(ns)?.iter().next().is_some() {
            let computed: Vec<Document> = self.computed().iter().map(Computed::to_document).collect();
            explanation.insert("computables", computed);
        }
        Ok(explanation)
    }

    /// Counts matches; see [`Store::count`].
    pub fn count<'q>(&self, ns: &Namespace, query: impl Into<Query<'q>>) -> Result<u64, StoreError> {
        let query = query.into();
        self.answer(&[(ns, query.filter)], Answering::Reading, |view| {
            if let Some(extended) = self.extended(&[(ns, query.filter)], query.modifiers, view)? {
                let filter = hidden_metadata::in_filter(query.filter);
                return extended.count(ns, Query { filter: &filter, ..query });
            }
            let visible = view.filter(query.filter);
            let count = || self.tally(ns, Query { filter: &visible, ..query }, view);
            self.journal.note("count", Some(ns), |count| *count, count)
        })
    }

    /// All distinct values; see [`Store::distinct`].
    pub fn distinct<'q>(
        &self,
        ns: &Namespace,
        field: &str,
        query: impl Into<Query<'q>>,
    ) -> Result<Vec<Bson>, StoreError> {
        self.values(ns, field, query)?.collect()
    }

    /// Distinct values; see [`Store::values`].
    pub fn values<'q>(&self, ns: &Namespace, field: &str, query: impl Into<Query<'q>>) -> Result<Values, StoreError> {
        let query = query.into();
        self.answer(&[(ns, query.filter)], Answering::Asking, |view| {
            if let Some(extended) = self.extended(&[(ns, query.filter)], query.modifiers, view)? {
                let filter = hidden_metadata::in_filter(query.filter);
                return extended.values(ns, field, Query { filter: &filter, ..query });
            }
            let visible = view.filter(query.filter);
            let start = Instant::now();
            let values = self.routes.reading(ns)?.values(ns, field, Query { filter: &visible, ..query })?;
            Ok(self.journal.watch("distinct", ns, start, values))
        })
    }

    /// Runs a pipeline; its results are without metadata, see [`Store::aggregate`].
    pub fn aggregate<'p>(
        &self,
        ns: &Namespace,
        pipeline: impl Into<Aggregation<'p>>,
    ) -> Result<Documents<'_>, StoreError> {
        let results = self.run_pipeline(ns, pipeline.into(), false)?;
        Ok(Box::new(results.map(|document| Ok(metadata::hide_within(document?)?))))
    }

    /// Runs a pipeline that only reads; see [`Memory::aggregate`].
    ///
    /// # Errors
    /// Where its last stage writes, or the store fails.
    pub fn aggregate_reading(&self, ns: &Namespace, stages: &[Document]) -> Result<Documents<'_>, StoreError> {
        match writing_stage(stages) {
            Some(name) => {
                let message = format!("{name} writes, and here a pipeline only reads; `rmem aggregate` runs it");
                Err(QueryError::bad_value(message).about(name).into())
            }
            None => self.aggregate(ns, stages),
        }
    }

    /// Runs a pipeline whose stages see the metadata, and whose results keep it.
    pub fn aggregate_with_metadata(
        &self,
        ns: &Namespace,
        pipeline: Aggregation<'_>,
    ) -> Result<Documents<'_>, StoreError> {
        self.run_pipeline(ns, pipeline, true)
    }

    fn run_pipeline(
        &self,
        ns: &Namespace,
        pipeline: Aggregation<'_>,
        shows_metadata: bool,
    ) -> Result<Documents<'_>, StoreError> {
        let writes = writing_stage(pipeline.stages).is_some();
        if writes {
            pipeline.stages.iter().try_for_each(metadata::check_stored_stage)?;
        }
        let asked = computables::questions(ns, pipeline.stages);
        for other in asked.iter().map(|(other, _)| other).chain(&computables::target(ns, pipeline.stages)) {
            self.routes.check_reach(ns, other)?;
        }
        if let Some(target) = computables::target(ns, pipeline.stages).filter(|ns| ns.collection == computables::KEPT) {
            let message =
                format!("{target} keeps computables, and a pipeline cannot write there; `rmem computables add` does");
            return Err(QueryError::bad_value(message).into());
        }
        let questions: Vec<_> = asked.iter().map(|(ns, query)| (ns, query)).collect();
        if writes && self.is_extended(&questions)? {
            let message =
                "a pipeline that writes cannot ask for keys that computables add, since they are stored nowhere";
            return Err(QueryError::bad_value(message).into());
        }
        let work = |view: &View| {
            let stages = computables::visible_stages(ns, pipeline.stages, view, shows_metadata);
            let pipeline = Aggregation { stages: &stages, ..pipeline };
            if let Some(extended) = if writes { None } else { self.extended(&questions, pipeline.modifiers, view)? } {
                return Ok(ready(extended.aggregate(ns, pipeline)?));
            }
            let start = Instant::now();
            let store = self.routes.writing(ns, writes)?;
            let results = store.aggregate(ns, pipeline)?;
            settled(view, self.journal.watch("aggregate", ns, start, results))
        };
        self.answer(&questions, if writes { Answering::Writing } else { Answering::Asking }, work)
    }

    /// Changes documents; see [`Store::update`].
    pub fn update(&self, ns: &Namespace, update: &UpdateRequest) -> Result<Updated, StoreError> {
        let update = UpdateRequest {
            filter: self.visible(&update.filter),
            update: hidden_metadata::in_update(&update.update),
            array_filters: update.array_filters.clone(),
            many: update.many,
            upsert: update.upsert,
            modifiers: update.modifiers.clone(),
        };
        self.check_kept_update(ns, &update)?;
        let work = || {
            let store = self.routes.writing(ns, update.upsert)?;
            store.update(ns, &update, Some(self.clock.now()))
        };
        self.journal.note("update", Some(ns), |updated: &Updated| updated.modified, work)
    }

    /// Removes documents; see [`Store::delete`]. What is removed as a whole loses what was computed, too.
    pub fn delete<'q>(&self, ns: &Namespace, query: impl Into<Query<'q>>, first_only: bool) -> Result<u64, StoreError> {
        let query = query.into();
        let store = self.routes.reading(ns)?;
        let visible = self.visible(query.filter);
        let delete = || store.delete(ns, Query { filter: &visible, ..query }, first_only);
        let deleted = self.journal.note("delete", Some(ns), |count| *count, delete)?;
        if query.filter.is_empty() && !first_only {
            computables::forget(store, ns)?;
            store.delete(ns, (&doc! { metadata::TOKEN_PATH: { "$ne": null } }).into(), false)?;
        }
        Ok(deleted)
    }

    /// Removes a collection; see [`Store::drop`].
    pub fn drop_collection(&self, ns: &Namespace) -> Result<bool, StoreError> {
        let work = || {
            let store = self.routes.reading(ns)?;
            computables::forget(store, ns)?;
            store.drop(ns)
        };
        self.journal.note("drop", Some(ns), |found| u64::from(*found), work)
    }

    /// Removes all collections of a database, also rmem's own; returns those of applications.
    pub fn drop_database(&self, database: &str) -> Result<Vec<Namespace>, StoreError> {
        let any = Namespace { database: database.to_owned(), collection: "any".to_owned() };
        let work = || {
            let mut found = self.routes.collections_beside(&any)?;
            found.retain(|ns| ns.database == database);
            let namespaces: Vec<&Namespace> = found.iter().collect();
            let store = self.routes.reading(&any)?;
            let drop_all = |_| {
                namespaces.iter().try_for_each(|ns| store.drop(ns).map(drop))?;
                if namespaces.is_empty() { Ok(()) } else { store.note_dropped(database) }
            };
            self.atomically(&namespaces, |error| error, drop_all)?;
            found.retain(|ns| !ns.is_own());
            Ok(found)
        };
        self.journal.note("drop database", None, |found: &Vec<Namespace>| length(found), work)
    }

    /// The filter, for documents that may be changed.
    fn visible(&self, filter: &Document) -> Document {
        self.computables.view(self.clock.now()).filter(filter)
    }

    /// Shows every operation from now on all that the cache of computables holds, or only what was computed for it.
    pub fn show_computed(&self, is_shown: bool) {
        self.computables.show(is_shown);
    }

    /// The same memory with computables, which run where a query needs them.
    #[must_use]
    pub fn with_computables(self, registry: Registry) -> Self {
        Self { computables: Box::new(Computables::new(registry)), ..self }
    }

    /// The same memory, which says once what is odd and concerns others.
    #[must_use]
    pub fn with_warnings(self, warnings: computables::Warnings) -> Self {
        self.computables.set_warnings(warnings);
        self
    }

    /// The same memory, whose stores give their warnings to `warn`: a document was stored though it does not pass the
    /// validator of its collection.
    #[must_use]
    pub fn warning_by(self, warn: &Warn) -> Self {
        self.routes.warn_by(warn);
        self
    }

    /// What was computed, or found in the cache, for the last query, count or pipeline.
    #[must_use]
    pub fn computed(&self) -> Vec<Computed> {
        self.computables.computed()
    }

    /// Gives a collection another name; see [`Store::rename`].
    pub fn rename_collection(&self, from: &Namespace, to: &Namespace, drop_target: bool) -> Result<(), StoreError> {
        let work = || {
            self.check_kept_rename(from, to)?;
            let store = self.routes.of(to)?;
            // What is replaced loses what was computed before it is gone; what is refused to be replaced loses nothing.
            if drop_target {
                computables::forget(store, to)?;
            }
            store.rename(from, to, drop_target)?;
            if drop_target { Ok(()) } else { computables::forget(store, to) }
        };
        self.journal.note("rename", Some(to), |()| 1, work)
    }

    /// All collections of both stores, each where its database belongs, sorted.
    pub fn collections(&self) -> Result<Vec<Namespace>, StoreError> {
        self.listed(|| self.routes.collections())
    }

    /// Those of the stores that can be reached, sorted, and why another store cannot.
    pub fn reachable_collections(&self) -> (Vec<Namespace>, Result<(), StoreError>) {
        let (mut all, mut done) = (Vec::new(), Ok(()));
        for (_, found) in self.routes.collections_by_store() {
            match self.listed(|| found) {
                Ok(found) => all.extend(found),
                Err(error) => done = done.and(Err(error)),
            }
        }
        all.sort();
        (all, done)
    }

    /// The collections in the store of `ns`; no other store is asked.
    pub fn collections_beside(&self, ns: &Namespace) -> Result<Vec<Namespace>, StoreError> {
        self.listed(|| self.routes.collections_beside(ns))
    }

    /// The listed collections, without those that rmem keeps for itself.
    fn listed(&self, list: impl FnOnce() -> Result<Vec<Namespace>, StoreError>) -> Result<Vec<Namespace>, StoreError> {
        let work = || {
            let mut found = list()?;
            found.retain(|ns| !ns.is_own());
            Ok(found)
        };
        self.journal.note("collections", None, |found: &Vec<Namespace>| length(found), work)
    }
}

/// The last stage of a pipeline, where it stores the results.
fn writing_stage(stages: &[Document]) -> Option<&str> {
    let name = stages.last()?.keys().next()?;
    matches!(name.as_str(), "$out" | "$merge").then_some(name)
}

/// The filter, for stored documents that have not decayed.
pub(super) fn stored(now: DateTime, filter: &Document) -> Document {
    let stored = doc! { metadata::info_path("computed"): { "$ne": true } };
    let filter = if filter.is_empty() {
        stored
    } else {
        doc! { "$and": [filter.clone(), stored] }
    };
    View::at(now).filter(&filter)
}

fn length<T>(items: &[T]) -> u64 {
    u64::try_from(items.len()).unwrap_or(u64::MAX)
}

/// Whether the metadata of documents that are found is hidden: a projection that names some asks for it.
pub(super) fn has_hidden(projection: &Document) -> bool {
    !projection.keys().any(|path| is_metadata(path))
}

/// Whether a dotted path leads into the metadata.
fn is_metadata(path: &str) -> bool {
    path.split('.').next() == Some(metadata::INFO)
}

/// Documents that may be computed anew meanwhile are read at once.
fn settled<'a>(view: &View, documents: Documents<'a>) -> Result<Documents<'a>, StoreError> {
    if !view.is_computed() {
        return Ok(documents);
    }
    Ok(ready(documents.collect::<Result<Vec<_>, _>>()?))
}

/// Documents that no longer need their store.
fn ready<'a>(documents: Vec<RawDocumentBuf>) -> Documents<'a> {
    Box::new(documents.into_iter().map(Ok))
}

fn without_metadata(documents: Documents<'_>) -> Documents<'_> {
    Box::new(documents.map(|document| Ok(metadata::hide(document?)?)))
}
