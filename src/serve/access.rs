//! The memory as a client sees it.
//!
//! A plain client sees documents without `_robmem_info`, which the memory keeps; with `--meta`,
//! with it. rmem itself as a client keeps the metadata, and computes, by itself, as it does on
//! MongoDB: it is given the store as it is.

use std::collections::BTreeMap;

use bson::{Bson, Document};

use crate::memory::Memory;
use crate::store::{
    Aggregation, Documents, Find, FindAndModify, Inserted, Modified, Namespace, Query, Store, StoreError,
    UpdateRequest, Updated,
};

/// The collection of what writes were answered; no client lists it.
pub(super) const RECORDS: &str = "rmem.retries";

/// The database where that is for all databases in a file.
pub(super) const OF_FILES: &str = "config";

/// Where it is for the writes in a database: of those in a file, in one place, which stays when the database is dropped; of
/// a shared database, in itself, since it may be in another store.
pub(super) fn records(memory: &Memory, database: &str) -> Namespace {
    let database = if memory.is_shared(&in_database(database)) { database } else { OF_FILES };
    in_database(database)
}

/// That collection in a database.
pub(super) fn in_database(database: &str) -> Namespace {
    Namespace { database: database.to_owned(), collection: RECORDS.to_owned() }
}

/// Where `_robmem_info` is kept, and whether clients see it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Metadata {
    /// The memory keeps it, and clients do not see it.
    #[default]
    Hidden,
    /// The memory keeps it, and the client sees it.
    Shown,
    /// The client keeps it: it is rmem.
    Own,
}

/// A memory and how a client sees it.
#[derive(Clone, Copy)]
pub(super) struct Access<'m> {
    pub(super) memory: &'m Memory,
    pub(super) metadata: Metadata,
}

impl<'m> Access<'m> {
    pub(super) fn new(memory: &'m Memory, metadata: Metadata) -> Self {
        Self { memory, metadata }
    }

    fn store(self, ns: &Namespace) -> Result<Option<&'m dyn Store>, StoreError> {
        (self.metadata == Metadata::Own).then(|| self.memory.bare(ns)).transpose()
    }

    pub(super) fn find(self, ns: &Namespace, find: &Find) -> Result<Documents<'m>, StoreError> {
        match (self.store(ns)?, self.metadata) {
            (Some(store), _) => store.find(ns, find),
            (None, Metadata::Shown) => self.memory.find_with_metadata(ns, find),
            (None, _) => self.memory.find(ns, find),
        }
    }

    pub(super) fn aggregate(self, ns: &Namespace, pipeline: Aggregation<'_>) -> Result<Documents<'m>, StoreError> {
        match (self.store(ns)?, self.metadata) {
            (Some(store), _) => store.aggregate(ns, pipeline),
            (None, Metadata::Shown) => self.memory.aggregate_with_metadata(ns, pipeline),
            (None, _) => self.memory.aggregate(ns, pipeline),
        }
    }

    pub(super) fn explain(self, ns: &Namespace, find: &Find) -> Result<Document, StoreError> {
        self.store(ns)?.map_or_else(|| self.memory.explain(ns, find), |store| store.explain(ns, find))
    }

    pub(super) fn count(self, ns: &Namespace, query: Query<'_>) -> Result<u64, StoreError> {
        self.store(ns)?.map_or_else(|| self.memory.count(ns, query), |store| store.count(ns, query))
    }

    pub(super) fn distinct(self, ns: &Namespace, field: &str, query: Query<'_>) -> Result<Vec<Bson>, StoreError> {
        match self.store(ns)? {
            Some(store) => store.distinct(ns, field, query),
            None => self.memory.distinct(ns, field, query),
        }
    }

    pub(super) fn insert(self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        match self.store(ns)? {
            Some(store) => {
                self.memory.check_kept(ns, &documents)?;
                store.insert(ns, documents)
            }
            None => self.memory.insert(ns, documents),
        }
    }

    pub(super) fn update(self, ns: &Namespace, update: &UpdateRequest) -> Result<Updated, StoreError> {
        match self.store(ns)? {
            Some(store) => {
                self.memory.check_kept_update(ns, update)?;
                store.update(ns, update, None)
            }
            None => self.memory.update(ns, update),
        }
    }

    pub(super) fn find_and_modify(self, ns: &Namespace, request: &FindAndModify) -> Result<Modified, StoreError> {
        match (self.store(ns)?, self.metadata) {
            (Some(store), _) => {
                self.memory.check_kept_modification(ns, request)?;
                store.find_and_modify(ns, request, None)
            }
            (None, Metadata::Shown) => self.memory.find_and_modify_with_metadata(ns, request),
            (None, _) => self.memory.find_and_modify(ns, request),
        }
    }

    pub(super) fn delete(self, ns: &Namespace, query: Query<'_>, first_only: bool) -> Result<u64, StoreError> {
        match self.store(ns)? {
            Some(store) => store.delete(ns, query, first_only),
            None => self.memory.delete(ns, query, first_only),
        }
    }

    pub(super) fn collections(self) -> Result<Vec<Namespace>, StoreError> {
        Ok(self.seen(self.memory.all_collections()?))
    }

    /// Those by database. One of the shared store has none while that cannot be reached.
    pub(super) fn databases(self) -> Result<BTreeMap<String, Vec<Namespace>>, StoreError> {
        let all = self.memory.databases()?.into_iter();
        let seen = all.map(|(name, collections)| (name, collections.is_empty(), self.seen(collections)));
        let seen = seen.filter(|(_, is_away, collections)| *is_away || !collections.is_empty());
        Ok(seen.map(|(name, _, collections)| (name, collections)).collect())
    }

    /// The collections of a database.
    pub(super) fn collections_of(self, database: &str) -> Result<Vec<Namespace>, StoreError> {
        Ok(self.seen(self.memory.collections_of(database)?))
    }

    fn seen(self, mut all: Vec<Namespace>) -> Vec<Namespace> {
        match self.metadata {
            Metadata::Own => all.retain(|ns| ns.collection != RECORDS),
            _ => all.retain(|ns| !ns.is_own()),
        }
        all
    }

    pub(super) fn drop(self, ns: &Namespace) -> Result<bool, StoreError> {
        self.store(ns)?.map_or_else(|| self.memory.drop_collection(ns), |store| store.drop(ns))
    }
}
