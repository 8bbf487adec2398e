//! Indexes of the memory's collections.

use super::Memory;
use crate::store::{Index, IndexChange, Namespace, StoreError};

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

    /// Changes an index; see [`crate::store::Store::modify_index`].
    pub fn modify_index(&self, ns: &Namespace, name: &str, change: IndexChange) -> Result<bool, StoreError> {
        let what = match change {
            IndexChange { hidden: Some(true), expire_after: None } => "hide index",
            IndexChange { hidden: Some(false), expire_after: None } => "unhide index",
            _ => "modify index",
        };
        let work = || self.routes.reading(ns)?.modify_index(ns, name, change);
        self.journal.note(what, Some(ns), |found| u64::from(*found), work)
    }

    /// The indexes of a collection; see [`crate::store::Store::indexes`].
    pub fn indexes(&self, ns: &Namespace) -> Result<Vec<Index>, StoreError> {
        let count = |indexes: &Vec<Index>| indexes.len() as u64;
        self.journal.note("indexes", Some(ns), count, || self.routes.reading(ns)?.indexes(ns))
    }
}
