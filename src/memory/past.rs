//! The memory as it was at a time: every collection that is read is taken from the history.
//!
//! A collection is put into a memory in this process when it is first read. Computables run on what
//! the memory was; nothing is written to the real stores.

use std::cell::RefCell;
use std::collections::HashSet;

use bson::{DateTime, Document};

use super::Memory;
use super::clock::Clock;
use super::computables;
use super::route::{Lazy, Routes};
use crate::calendar::day_and_time;
use crate::query::{Collation, QueryError};
use crate::store::{
    Aggregation, Changes, Documents, Embedded, Find, FindAndModify, Index, IndexChange, Inserted, Modified, Name,
    Namespace, Put, Query, Store, StoreError, UpdateRequest, Updated, Validation, Values, index,
};

/// How many documents are decoded at once.
const BATCH: usize = 1000;

/// Stores as they were.
struct Past {
    source: Routes,
    at: DateTime,
    copy: Embedded,
    filled: RefCell<HashSet<Namespace>>,
}

impl Memory {
    /// The memory as it was at a time; it cannot be changed.
    ///
    /// # Errors
    /// Where there is not enough memory for a copy.
    pub fn as_of(self, at: DateTime) -> Result<Self, StoreError> {
        let Self { routes, journal, computables, .. } = self;
        let past = Past { source: routes, at, copy: Embedded::in_memory()?, filled: RefCell::default() };
        let routes = Routes::new(Lazy::open(Box::new(past)), None, Vec::new());
        Ok(Self { routes, clock: Clock::Stopped(at), journal, computables })
    }
}

impl Past {
    /// The copy, with a collection in it.
    fn with(&self, ns: &Namespace) -> Result<&Embedded, StoreError> {
        // What rmem keeps for itself, such as what was computed, is of this process alone; computables are those of now.
        if (!ns.is_own() || ns.collection == computables::KEPT) && !self.filled.borrow().contains(ns) {
            let source = self.source.reading(ns)?;
            let documents = match ns.is_own() {
                true => source.find(ns, &Find::default())?.collect::<Result<_, _>>()?,
                false => source.as_of(ns, self.at)?,
            };
            // A part of it may be there after an error.
            Store::drop(&self.copy, ns)?;
            // The collation is that of now: it cannot change while there are documents.
            if let Some(collation) = index::collation(&source.indexes(ns)?) {
                Store::create(&self.copy, ns, Some(&collation))?;
            }
            for batch in documents.chunks(BATCH) {
                let batch: Result<Vec<Document>, _> = batch.iter().map(|raw| Document::try_from(&**raw)).collect();
                self.copy.insert(ns, batch.map_err(QueryError::from)?)?;
            }
            // Only now: after an error, the collection is copied again.
            self.filled.borrow_mut().insert(ns.clone());
        }
        Ok(&self.copy)
    }

    fn refuse<T>(&self) -> Result<T, StoreError> {
        Err(QueryError::bad_value("the memory as it was cannot be changed; leave out --at").into())
    }
}

impl Store for Past {
    fn insert(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        // Computed documents, for as long as this process runs.
        self.with(ns)?.insert(ns, documents)
    }

    fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        self.with(ns)?.find(ns, find)
    }

    fn explain(&self, ns: &Namespace, find: &Find) -> Result<Document, StoreError> {
        self.with(ns)?.explain(ns, find)
    }

    fn count(&self, ns: &Namespace, query: Query<'_>) -> Result<u64, StoreError> {
        self.with(ns)?.count(ns, query)
    }

    fn values(&self, ns: &Namespace, field: &str, query: Query<'_>) -> Result<Values, StoreError> {
        self.with(ns)?.values(ns, field, query)
    }

    fn aggregate(&self, ns: &Namespace, pipeline: Aggregation<'_>) -> Result<Documents<'_>, StoreError> {
        if computables::target(ns, pipeline.stages).is_some() {
            return self.refuse();
        }
        for (other, _) in computables::questions(ns, pipeline.stages) {
            self.with(&other)?;
        }
        self.with(ns)?.aggregate(ns, pipeline)
    }

    fn update(
        &self,
        ns: &Namespace,
        update: &UpdateRequest,
        timestamp: Option<DateTime>,
    ) -> Result<Updated, StoreError> {
        self.with(ns)?.update(ns, update, timestamp)
    }

    fn find_and_modify(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        timestamp: Option<DateTime>,
    ) -> Result<Modified, StoreError> {
        self.with(ns)?.find_and_modify(ns, request, timestamp)
    }

    fn put(&self, ns: &Namespace, documents: Vec<Document>, timestamp: Option<DateTime>) -> Result<Put, StoreError> {
        self.with(ns)?.put(ns, documents, timestamp)
    }

    fn delete(&self, ns: &Namespace, query: Query<'_>, first_only: bool) -> Result<u64, StoreError> {
        self.with(ns)?.delete(ns, query, first_only)
    }

    fn drop(&self, _: &Namespace) -> Result<bool, StoreError> {
        self.refuse()
    }

    fn rename(&self, _: &Namespace, _: &Namespace, _: bool) -> Result<(), StoreError> {
        self.refuse()
    }

    fn create_index(&self, ns: &Namespace, index: &Index) -> Result<bool, StoreError> {
        self.with(ns)?.create_index(ns, index)
    }

    fn modify_index(&self, _: &Namespace, _: &str, _: IndexChange) -> Result<bool, StoreError> {
        self.refuse()
    }

    fn drop_index(&self, _: &Namespace, _: &str) -> Result<bool, StoreError> {
        self.refuse()
    }

    fn indexes(&self, ns: &Namespace) -> Result<Vec<Index>, StoreError> {
        self.with(ns)?.indexes(ns)
    }

    /// The collections of which there were documents, sorted.
    fn collections(&self) -> Result<Vec<Namespace>, StoreError> {
        let mut all = self.source.collections()?;
        for store in self.source.stores()? {
            all.extend(store.changed_collections()?);
        }
        all.sort();
        all.dedup();
        let mut there = Vec::new();
        for ns in all.into_iter().filter(|ns| !ns.is_own()) {
            if self.with(&ns)?.count(&ns, (&Document::new()).into())? > 0 {
                there.push(ns);
            }
        }
        Ok(there)
    }

    fn watch(&self, _: &Namespace, _: Option<&str>) -> Result<Box<dyn Changes + '_>, StoreError> {
        self.refuse()
    }

    fn forget(&self, _: &Namespace, _: &str) -> Result<bool, StoreError> {
        self.refuse()
    }

    fn names(&self) -> Result<Vec<Name>, StoreError> {
        Ok(Vec::new())
    }

    fn create(&self, ns: &Namespace, collation: Option<&Collation>) -> Result<bool, StoreError> {
        Store::create(self.with(ns)?, ns, collation)
    }

    fn validation(&self, ns: &Namespace) -> Result<Option<Validation>, StoreError> {
        self.source.reading(ns)?.validation(ns)
    }

    fn set_validation(&self, _: &Namespace, _: &Validation) -> Result<(), StoreError> {
        self.refuse()
    }

    fn unvalidated(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        // The copy takes every document.
        work()
    }

    fn describe(&self) -> String {
        format!("{} as of {}", self.source.describe(), day_and_time(self.at.timestamp_millis()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_collection_that_could_not_be_copied_is_not_empty_afterwards() {
        let ns = Namespace::parse("a.b").unwrap();
        let store = Embedded::in_memory().unwrap();
        store.insert(&ns, vec![Document::new()]).unwrap();
        let past = Memory::new(Box::new(store), None, Vec::new()).as_of(DateTime::from_millis(0)).unwrap();
        for _ in 0..2 {
            assert!(past.count(&ns, &Document::new()).is_err());
        }
    }
}
