//! The memory: what an application talks to.
//!
//! Operations with metadata, routed to the local or the shared store by the
//! database's name.

use bson::{Bson, Document};

use crate::store::{Documents, Find, Inserted, Namespace, Store, StoreError, UpdateRequest, Updated};

/// A local store and, perhaps, another one for shared databases.
pub struct Memory {
    local: Box<dyn Store>,
    shared: Option<Box<dyn Store>>,
    shared_databases: Vec<String>,
}

impl Memory {
    /// A memory over one store, or over two with databases named that go to `shared`.
    #[must_use]
    pub fn new(local: Box<dyn Store>, shared: Option<Box<dyn Store>>, shared_databases: Vec<String>) -> Self {
        Self { local, shared, shared_databases }
    }

    /// The store of a namespace's database.
    fn store(&self, ns: &Namespace) -> &dyn Store {
        match &self.shared {
            Some(shared) if self.shared_databases.contains(&ns.database) => shared.as_ref(),
            _ => self.local.as_ref(),
        }
    }

    /// Stores documents; see [`Store::insert`].
    pub fn insert(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        self.store(ns).insert(ns, documents)
    }

    /// Answers a query; see [`Store::find`].
    pub fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        self.store(ns).find(ns, find)
    }

    /// Counts matches; see [`Store::count`].
    pub fn count(&self, ns: &Namespace, filter: &Document) -> Result<u64, StoreError> {
        self.store(ns).count(ns, filter)
    }

    /// Distinct values; see [`Store::distinct`].
    pub fn distinct(&self, ns: &Namespace, field: &str, filter: &Document) -> Result<Vec<Bson>, StoreError> {
        self.store(ns).distinct(ns, field, filter)
    }

    /// Runs a pipeline; see [`Store::aggregate`].
    pub fn aggregate(&self, ns: &Namespace, pipeline: &[Document]) -> Result<Documents<'_>, StoreError> {
        self.store(ns).aggregate(ns, pipeline)
    }

    /// Changes documents; see [`Store::update`].
    pub fn update(&self, ns: &Namespace, update: &UpdateRequest) -> Result<Updated, StoreError> {
        self.store(ns).update(ns, update)
    }

    /// Removes documents; see [`Store::delete`].
    pub fn delete(&self, ns: &Namespace, filter: &Document, first_only: bool) -> Result<u64, StoreError> {
        self.store(ns).delete(ns, filter, first_only)
    }

    /// Removes a collection; see [`Store::drop`].
    pub fn drop_collection(&self, ns: &Namespace) -> Result<bool, StoreError> {
        self.store(ns).drop(ns)
    }

    /// All collections of both stores, sorted.
    pub fn collections(&self) -> Result<Vec<Namespace>, StoreError> {
        let Some(shared) = &self.shared else { return self.local.collections() };
        let is_shared = |ns: &Namespace| self.shared_databases.contains(&ns.database);
        let mut all: Vec<_> = self.local.collections()?.into_iter().filter(|ns| !is_shared(ns)).collect();
        all.extend(shared.collections()?.into_iter().filter(is_shared));
        all.sort();
        Ok(all)
    }
}
