//! The operations, each on the store its namespace belongs to.

use std::time::Instant;

use bson::{Bson, Document, doc};

use super::clock::Clock;
use super::journal::{Journal, Observer};
use super::route::{Lazy, Routes};
use crate::store::{
    Documents, Find, Inserted, Namespace, Put, Role, Store, StoreError, StoreUri, UpdateRequest, Updated, stamp,
};

/// Stages that have to be the first of a pipeline.
const FIRST_ONLY: [&str; 11] = [
    "$changeStream",
    "$collStats",
    "$currentOp",
    "$documents",
    "$geoNear",
    "$indexStats",
    "$listLocalSessions",
    "$listSessions",
    "$planCacheStats",
    "$search",
    "$searchMeta",
];

/// A local store and, perhaps, another one for shared databases.
pub struct Memory {
    pub(super) routes: Routes,
    pub(super) clock: Clock,
    pub(super) journal: Journal,
}

impl Memory {
    /// A memory over one store, or over two with databases named that go to `shared`.
    #[must_use]
    pub fn new(local: Box<dyn Store>, shared: Option<Box<dyn Store>>, shared_databases: Vec<String>) -> Self {
        let routes = Routes::new(Lazy::open(local), shared.map(Lazy::open), shared_databases);
        Self { routes, clock: Clock::System, journal: Journal::default() }
    }

    /// A memory over the stores at these addresses. Each is opened by the
    /// first operation that needs it; equal addresses are one store.
    #[must_use]
    pub fn at(local: StoreUri, shared: StoreUri, shared_databases: Vec<String>) -> Self {
        let shared = (local != shared).then(|| Lazy::at(shared, Role::Shared));
        let routes = Routes::new(Lazy::at(local, Role::Local), shared, shared_databases);
        Self { routes, clock: Clock::System, journal: Journal::default() }
    }

    /// The same memory with another clock.
    #[must_use]
    pub fn with_clock(self, clock: Clock) -> Self {
        Self { clock, ..self }
    }

    /// The same memory, whose operations are told to `observer` as they end.
    #[must_use]
    pub fn with_observer(self, observer: Observer) -> Self {
        Self { journal: Journal::new(observer), ..self }
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

    /// Stores documents; see [`Store::insert`].
    pub fn insert(&self, ns: &Namespace, mut documents: Vec<Document>) -> Result<Inserted, StoreError> {
        let now = self.clock.now();
        for document in &mut documents {
            stamp::insert(document, now)?;
        }
        self.journal.note(
            "insert",
            Some(ns),
            |inserted: &Inserted| length(&inserted.ids),
            || self.routes.of(ns)?.insert(ns, documents),
        )
    }

    /// Stores documents in place of those with their `_id`s; see [`Store::put`].
    pub fn put(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Put, StoreError> {
        let count = length(&documents);
        documents.iter().try_for_each(stamp::check)?;
        self.journal.note("put", Some(ns), |_| count, || self.routes.of(ns)?.put(ns, documents, Some(self.clock.now())))
    }

    /// Answers a query with documents as applications see them: without
    /// metadata, unless the projection names some. See [`Store::find`].
    pub fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        let documents = self.find_with_metadata(ns, find)?;
        if find.projection.keys().any(|key| is_metadata(key)) {
            return Ok(documents);
        }
        Ok(without_metadata(documents))
    }

    /// Answers a query with documents and their metadata.
    pub fn find_with_metadata(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        let start = Instant::now();
        let find = Find { filter: self.visible(&find.filter), ..find.clone() };
        Ok(self.journal.watch("find", ns, start, self.routes.reading(ns)?.find(ns, &find)?))
    }

    /// Says how a query is answered; see [`Store::explain`].
    pub fn explain(&self, ns: &Namespace, find: &Find) -> Result<Document, StoreError> {
        let find = Find { filter: self.visible(&find.filter), ..find.clone() };
        self.journal.note("explain", Some(ns), |_| 1, || self.routes.reading(ns)?.explain(ns, &find))
    }

    /// Counts matches; see [`Store::count`].
    pub fn count(&self, ns: &Namespace, filter: &Document) -> Result<u64, StoreError> {
        let filter = self.visible(filter);
        self.journal.note("count", Some(ns), |count| *count, || self.routes.reading(ns)?.count(ns, &filter))
    }

    /// Distinct values; see [`Store::distinct`].
    pub fn distinct(&self, ns: &Namespace, field: &str, filter: &Document) -> Result<Vec<Bson>, StoreError> {
        let filter = self.visible(filter);
        self.journal.note(
            "distinct",
            Some(ns),
            |values: &Vec<Bson>| length(values),
            || self.routes.reading(ns)?.distinct(ns, field, &filter),
        )
    }

    /// Runs a pipeline; its results are without metadata, see [`Store::aggregate`].
    pub fn aggregate(&self, ns: &Namespace, pipeline: &[Document]) -> Result<Documents<'_>, StoreError> {
        Ok(without_metadata(self.aggregate_with_metadata(ns, pipeline)?))
    }

    /// Runs a pipeline; its results keep their metadata.
    pub fn aggregate_with_metadata(&self, ns: &Namespace, pipeline: &[Document]) -> Result<Documents<'_>, StoreError> {
        let start = Instant::now();
        let last = pipeline.last().and_then(|stage| stage.keys().next());
        let store = match last.is_some_and(|name| name == "$out" || name == "$merge") {
            true => self.routes.of(ns)?,
            false => self.routes.reading(ns)?,
        };
        Ok(self.journal.watch("aggregate", ns, start, store.aggregate(ns, &self.visible_only(pipeline))?))
    }

    /// Changes documents; see [`Store::update`].
    pub fn update(&self, ns: &Namespace, update: &UpdateRequest) -> Result<Updated, StoreError> {
        let update = UpdateRequest { filter: self.visible(&update.filter), ..update.clone() };
        let work = || {
            let store = if update.upsert { self.routes.of(ns)? } else { self.routes.reading(ns)? };
            store.update(ns, &update, Some(self.clock.now()))
        };
        self.journal.note("update", Some(ns), |updated: &Updated| updated.modified, work)
    }

    /// Removes documents; see [`Store::delete`].
    pub fn delete(&self, ns: &Namespace, filter: &Document, first_only: bool) -> Result<u64, StoreError> {
        let filter = self.visible(filter);
        self.journal.note(
            "delete",
            Some(ns),
            |count| *count,
            || self.routes.reading(ns)?.delete(ns, &filter, first_only),
        )
    }

    /// Removes a collection; see [`Store::drop`].
    pub fn drop_collection(&self, ns: &Namespace) -> Result<bool, StoreError> {
        self.journal.note("drop", Some(ns), |found| u64::from(*found), || self.routes.reading(ns)?.drop(ns))
    }

    /// The filter, for documents that have not decayed.
    fn visible(&self, filter: &Document) -> Document {
        let visible = stamp::visible(self.clock.now());
        if filter.is_empty() {
            visible
        } else {
            doc! { "$and": [filter.clone(), visible] }
        }
    }

    /// The pipeline over documents that have not decayed. Those of other
    /// collections, which it looks up, are all seen.
    fn visible_only(&self, pipeline: &[Document]) -> Vec<Document> {
        let mut stages = pipeline.to_vec();
        match stages.first_mut().and_then(|stage| stage.iter_mut().next()) {
            Some((name, Bson::Document(filter))) if name == "$match" => *filter = self.visible(filter),
            Some((name, _)) if FIRST_ONLY.contains(&name.as_str()) => {}
            _ => stages.insert(0, doc! { "$match": stamp::visible(self.clock.now()) }),
        }
        stages
    }

    /// Gives a collection the name of another, in its place; see [`Store::rename`].
    pub fn rename_collection(&self, from: &Namespace, to: &Namespace) -> Result<(), StoreError> {
        self.journal.note("rename", Some(to), |()| 1, || self.routes.of(to)?.rename(from, to))
    }

    /// All collections of both stores, each where its database belongs, sorted.
    pub fn collections(&self) -> Result<Vec<Namespace>, StoreError> {
        self.journal.note("collections", None, |found: &Vec<Namespace>| length(found), || self.routes.collections())
    }
}

fn length<T>(items: &[T]) -> u64 {
    u64::try_from(items.len()).unwrap_or(u64::MAX)
}

/// Whether a dotted path leads into the metadata.
fn is_metadata(path: &str) -> bool {
    path.split('.').next() == Some(stamp::INFO)
}

fn without_metadata(documents: Documents<'_>) -> Documents<'_> {
    Box::new(documents.map(|document| Ok(stamp::hide(document?)?)))
}
