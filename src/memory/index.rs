//! Indexes of the memory's collections.

use super::Memory;
use crate::store::{Index, Namespace, StoreError};

impl Memory {
    /// Makes an index; see [`crate::store::Store::create_index`].
    pub fn create_index(&self, ns: &Namespace, index: &Index) -> Result<bool, StoreError> {
        let work = || self.routes.of(ns)?.create_index(ns, index);
        self.journal.note("create index", Some(ns), |made| u64::from(*made), work)
    }

    /// Refuses an index that the store of a collection cannot have; see [`crate::store::Store::check_index`].
    pub fn check_index(&self, ns: &Namespace, index: &Index) -> Result<(), StoreError> {
        self.routes.reading(ns)?.check_index(index)
    }

    /// Removes an index; see [`crate::store::Store::drop_index`].
    pub fn drop_index(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        let work = || self.routes.reading(ns)?.drop_index(ns, name);
        self.journal.note("drop index", Some(ns), |found| u64::from(*found), work)
    }

    /// Keeps an index from queries, or gives it back; see [`crate::store::Store::hide_index`].
    pub fn hide_index(&self, ns: &Namespace, name: &str, hidden: bool) -> Result<bool, StoreError> {
        let what = if hidden { "hide index" } else { "unhide index" };
        let work = || self.routes.reading(ns)?.hide_index(ns, name, hidden);
        self.journal.note(what, Some(ns), |found| u64::from(*found), work)
    }

    /// The indexes of a collection; see [`crate::store::Store::indexes`].
    pub fn indexes(&self, ns: &Namespace) -> Result<Vec<Index>, StoreError> {
        let count = |indexes: &Vec<Index>| indexes.len() as u64;
        self.journal.note("indexes", Some(ns), count, || self.routes.reading(ns)?.indexes(ns))
    }
}
