//! What a server needs of a memory that it shares among clients.

use std::collections::BTreeMap;

use bson::{DateTime, Document};

use super::Memory;
use crate::query::Collation;
use crate::store::{
    ChangePage, EventRequest, Events, Index, Kept, Namespace, Scope, ServerEvents, Since, Store, StoreError,
    Validation, index,
};

/// MongoDB's code for what a view has not.
const NOT_ON_VIEW: i32 = 166;

/// What has a name in a database.
#[derive(Debug, Clone, PartialEq)]
pub enum Listed {
    /// A collection, and its indexes.
    Collection(Vec<Index>),
    /// A view of a MongoDB server, and how it is defined.
    View(Document),
    /// A time series of a MongoDB server, and how it is defined.
    TimeSeries(Document),
}

impl Memory {
    /// The store that a collection is in, as it is: for callers that keep metadata themselves.
    ///
    /// # Errors
    /// Where the store cannot be opened.
    pub fn bare(&self, ns: &Namespace) -> Result<&dyn Store, StoreError> {
        self.store(ns)
    }

    /// Opens the local store, making its file where there is none.
    ///
    /// # Errors
    /// Where it cannot be opened.
    pub fn open_local(&self) -> Result<(), StoreError> {
        self.routes.scoped(&Scope::All).map(drop)
    }

    /// Opens the local store, where it is a file that is there.
    ///
    /// # Errors
    /// Where it cannot be opened.
    pub fn open_existing(&self) -> Result<(), StoreError> {
        self.routes.open_existing()
    }

    /// Reads what is in the local store.
    ///
    /// # Errors
    /// Where it cannot be opened, or its server does not answer.
    pub fn check_local(&self) -> Result<(), StoreError> {
        self.routes.local()?.collections().map(drop)
    }

    /// The same for the shared store, where there is one.
    ///
    /// # Errors
    /// As [`Memory::check_local`].
    pub fn check_shared(&self) -> Result<(), StoreError> {
        self.routes.shared()?.map_or(Ok(()), |shared| shared.collections().map(drop))
    }

    /// Limits about how many bytes of what was read each store keeps in this process.
    ///
    /// # Errors
    /// Where one that is open fails.
    pub fn limit_caches(&self, bytes: usize) -> Result<(), StoreError> {
        self.routes.limit_caches(bytes)
    }

    /// Frees the caches of the stores that are open; see [`Store::free_cache`].
    pub fn free_caches(&self) {
        self.routes.free_caches();
    }

    /// The indexes of a collection; of a view or a time series, how it is defined.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn collection_or_view(&self, ns: &Namespace) -> Result<Listed, StoreError> {
        let store = self.routes.reading(ns)?;
        match store.indexes(ns) {
            Err(StoreError::Query(error)) if error.code == NOT_ON_VIEW => {
                Ok(store.view(ns)?.map_or(Listed::Collection(Vec::new()), Listed::View))
            }
            indexes => Ok(match indexes? {
                // A time series has no index on `_id`.
                none if none.is_empty() => store.view(ns)?.map_or(Listed::Collection(none), Listed::TimeSeries),
                indexes => Listed::Collection(indexes),
            }),
        }
    }

    /// Reports that a database was removed; see [`Store::note_dropped`].
    ///
    /// # Errors
    /// Where the store fails.
    pub fn note_dropped(&self, database: &str) -> Result<(), StoreError> {
        self.routes.scoped(&Scope::Database(database.to_owned()))?.note_dropped(database)
    }

    /// The number of the collection that has a name; see [`Store::number`].
    ///
    /// # Errors
    /// Where the store fails.
    pub fn number(&self, ns: &Namespace) -> Result<Option<i64>, StoreError> {
        self.routes.reading(ns)?.number(ns)
    }

    /// Refuses a collection of which a reader would not find all documents; see [`Store::check_whole`].
    ///
    /// # Errors
    /// Where that is so, or the store fails.
    pub fn check_whole(&self, ns: &Namespace) -> Result<(), StoreError> {
        self.routes.reading(ns)?.check_whole(ns)
    }

    /// Brings what is in the logs of files into the files themselves; see [`Store::fold`].
    ///
    /// # Errors
    /// Where that is not possible at present.
    pub fn fold(&self) -> Result<(), StoreError> {
        self.routes.stores_in_files()?.into_iter().try_for_each(Store::fold)
    }

    /// All collections of both stores, with those that rmem keeps for itself.
    ///
    /// # Errors
    /// Where a store fails.
    pub fn all_collections(&self) -> Result<Vec<Namespace>, StoreError> {
        self.routes.collections()
    }

    /// The same by database. Where the shared store cannot be reached, its databases are there without collections.
    ///
    /// # Errors
    /// Where a store fails.
    pub fn databases(&self) -> Result<BTreeMap<String, Vec<Namespace>>, StoreError> {
        self.routes.databases()
    }

    /// The same without those that a server keeps: no server is asked.
    ///
    /// # Errors
    /// Where a file cannot be read.
    pub fn collections_in_files(&self) -> Result<Vec<Namespace>, StoreError> {
        self.routes.collections_in_files()
    }

    /// How many collections the private store has and, where databases are shared, the shared one, without those that rmem keeps
    /// for itself: each with its address. A store that fails says why.
    pub fn collection_counts(&self) -> impl Iterator<Item = (String, Result<usize, StoreError>)> {
        let count = |found: Vec<Namespace>| found.iter().filter(|ns| !ns.is_own()).count();
        self.routes.collections_by_store().map(move |(address, found)| (address, found.map(count)))
    }

    /// The collections of a database, with those that rmem keeps for itself; the store of other databases is not asked.
    ///
    /// # Errors
    /// Where its store fails.
    pub fn collections_of(&self, database: &str) -> Result<Vec<Namespace>, StoreError> {
        self.routes.collections_of(database)
    }

    /// Whether a database is shared among robots.
    #[must_use]
    pub fn is_shared(&self, ns: &Namespace) -> bool {
        self.routes.is_shared(ns)
    }

    /// Makes an empty collection; see [`Store::create`].
    ///
    /// # Errors
    /// Where the store fails.
    pub fn create_collection(&self, ns: &Namespace, collation: Option<&Collation>) -> Result<bool, StoreError> {
        self.journal.note("create", Some(ns), |made| u64::from(*made), || self.routes.of(ns)?.create(ns, collation))
    }

    /// How strings compare in a collection; nothing where they do byte by byte.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn collation(&self, ns: &Namespace) -> Result<Option<Collation>, StoreError> {
        Ok(index::collation(&self.routes.reading(ns)?.indexes(ns)?))
    }

    /// What a collection says of the documents that it takes; see [`Store::validation`].
    ///
    /// # Errors
    /// Where the store fails.
    pub fn validation(&self, ns: &Namespace) -> Result<Option<Validation>, StoreError> {
        self.routes.reading(ns)?.validation(ns)
    }

    /// Sets what a collection says of the documents that it takes; see [`Store::set_validation`].
    ///
    /// # Errors
    /// Where the validator is none, there is no such collection, or the store fails.
    pub fn set_validation(&self, ns: &Namespace, validation: &Validation) -> Result<(), StoreError> {
        let work = || self.routes.of(ns)?.set_validation(ns, validation);
        self.journal.note("set validator", Some(ns), |()| 1, work)
    }

    /// Makes an empty collection that takes certain documents; see [`Store::create_validating`].
    ///
    /// # Errors
    /// Where the validator is none, or the store fails.
    pub fn create_validating(
        &self,
        ns: &Namespace,
        collation: Option<&Collation>,
        validation: &Validation,
        images: Option<bool>,
    ) -> Result<bool, StoreError> {
        let work = || self.routes.of(ns)?.create_validating(ns, collation, validation, images);
        self.journal.note("create", Some(ns), |made| u64::from(*made), work)
    }

    /// Runs writes to the store that a collection is in also where documents do not pass its validator; see
    /// [`Store::unvalidated`].
    ///
    /// # Errors
    /// What `work` fails with.
    pub fn unvalidated(
        &self,
        ns: &Namespace,
        work: &mut dyn FnMut() -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        self.store(ns)?.unvalidated(work)
    }

    /// Runs operations on the store that a collection is in as one write; see [`Store::atomically`].
    ///
    /// # Errors
    /// What `work` fails with, or the store; then nothing was done.
    pub fn as_one(&self, ns: &Namespace, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        self.store(ns)?.atomically(work)
    }

    /// Whether the store that a collection is in has taken back all of what is being done as one write; see
    /// [`Store::is_rolled_back`].
    #[must_use]
    pub fn is_rolled_back(&self, ns: &Namespace) -> bool {
        self.store(ns).is_ok_and(|store| store.is_rolled_back())
    }

    /// Runs operations that see the store of a collection at one moment; see [`Store::at_one_moment`].
    ///
    /// # Errors
    /// What `work` fails with, or the store.
    pub fn at_one_moment(
        &self,
        ns: &Namespace,
        work: &mut dyn FnMut() -> Result<(), StoreError>,
    ) -> Result<bool, StoreError> {
        self.store(ns)?.at_one_moment(work)
    }

    /// Keeps the changes of a scope; see [`Store::keep_changes`].
    ///
    /// # Errors
    /// Where the store keeps none.
    pub fn keep_changes(&self, scope: &Scope, since: DateTime) -> Result<Kept, StoreError> {
        self.routes.scoped(scope)?.keep_changes(scope, since)
    }

    /// See [`Store::set_images`].
    ///
    /// # Errors
    /// Where the store's server cannot be reached or refuses.
    pub fn set_images(&self, ns: &Namespace, are_kept: bool) -> Result<(), StoreError> {
        self.bare(ns)?.set_images(ns, are_kept)
    }

    /// The databases that are not in the store where all others are.
    #[must_use]
    pub fn databases_elsewhere(&self) -> &[String] {
        self.routes.databases_elsewhere()
    }

    /// See [`Store::server_events`].
    ///
    /// # Errors
    /// Where the store is a file, or its server cannot be reached or refuses.
    pub fn server_events(
        &self,
        request: EventRequest,
        most: Option<u64>,
    ) -> Result<(Box<dyn ServerEvents>, Events), StoreError> {
        self.routes.scoped(&request.scope)?.server_events(request, most)
    }

    /// See [`Store::release_changes`].
    ///
    /// # Errors
    /// Where the store fails.
    pub fn release_changes(&self, scope: &Scope) -> Result<(), StoreError> {
        self.routes.scoped(scope)?.release_changes(scope)
    }

    /// The scopes whose changes are kept in files.
    ///
    /// # Errors
    /// Where one cannot be read.
    pub fn kept_scopes(&self) -> Result<Vec<Scope>, StoreError> {
        self.routes.kept_scopes()
    }

    /// See [`Store::changes`].
    ///
    /// # Errors
    /// Where the store keeps none, or not so far back.
    pub fn changes(&self, scope: &Scope, behind: i64, most: usize) -> Result<ChangePage, StoreError> {
        self.routes.scoped(scope)?.changes(scope, behind, most)
    }

    /// See [`Store::position_at`].
    ///
    /// # Errors
    /// Where the store keeps none.
    pub fn position_at(&self, scope: &Scope, time: DateTime) -> Result<Since, StoreError> {
        self.routes.scoped(scope)?.position_at(scope, time)
    }
}
