//! Removing expired documents.
//!
//! A decayed document is invisible at once; here it is removed. So are computed documents
//! whose cache time is over, documents that a TTL index has expired and, at a restart,
//! documents that are not persistent.

use bson::raw::RawBsonRef;
use bson::{Bson, DateTime, Document, doc};

use super::Memory;
use crate::query::QueryError;
use crate::store::{Find, Index, Namespace, StoreError, index, metadata};

/// How many documents are removed at once.
const BATCH: u64 = 1_000;

/// How many documents of a collection were removed, and why.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Expired {
    /// Their date of decay is past.
    pub decayed: u64,
    /// They were computed, and are too old.
    pub computed: u64,
    /// They are due by a TTL index.
    pub due: u64,
    /// They were not to outlive a restart.
    pub not_persistent: u64,
    /// The collection had more than the most documents that it keeps.
    pub surplus: u64,
}

impl Memory {
    /// Removes expired documents; with `restart`, also those that are not persistent. Returns
    /// the collections of which documents were removed, and why a store failed: that keeps nothing in the other one.
    pub fn expire(&self, restart: bool) -> (Vec<(Namespace, Expired)>, Result<(), StoreError>) {
        let mut all = Vec::new();
        let mut done = Ok(());
        for (_, collections) in self.routes.collections_by_store() {
            done = done.and(collections.and_then(|collections| self.expire_all(&collections, restart, &mut all)));
        }
        (all, done)
    }

    fn expire_all(
        &self,
        collections: &[Namespace],
        restart: bool,
        all: &mut Vec<(Namespace, Expired)>,
    ) -> Result<(), StoreError> {
        for ns in collections.iter().filter(|ns| !ns.is_own()) {
            let expired = match self.expire_collection(ns, restart) {
                // Of what another client shows as a collection, or keeps as a time series, nothing can be removed so.
                Err(StoreError::Query(_)) if self.routes.of(ns)?.view(ns)?.is_some() => continue,
                expired => expired?,
            };
            if expired != Expired::default() {
                all.push((ns.clone(), expired));
            }
        }
        Ok(())
    }

    /// Removes what an index expires by now from stores that do not do so themselves: for whoever runs for long.
    ///
    /// # Errors
    /// Where a store fails; what was removed before stays removed.
    pub fn expire_due(&self) -> Result<(), StoreError> {
        let now = self.clock.now();
        for ns in self.collections_in_files()?.into_iter().filter(|ns| !ns.is_own()) {
            let store = self.routes.of(&ns)?;
            for filter in store.indexes(&ns)?.iter().filter_map(|index| before(index, now)) {
                if store.count(&ns, (&filter).into())? > 0 {
                    self.expire_collection(&ns, false)?;
                    break;
                }
            }
        }
        Ok(())
    }

    /// Removes the oldest stored documents of a collection, by the date of their insertion, until it has at most so many.
    /// Returns how many were removed.
    ///
    /// # Errors
    /// Where a store fails; what was removed before stays removed.
    pub fn expire_surplus(&self, ns: &Namespace, most: u64) -> Result<u64, StoreError> {
        let mut removed = 0;
        loop {
            let surplus = self.count_stored(ns, &Document::new())?.saturating_sub(most);
            if surplus == 0 {
                return Ok(removed);
            }
            let sort = doc! { metadata::info_path(metadata::INSERTED): 1, "_id": 1 };
            let find = Find { sort, limit: surplus.min(BATCH), projection: doc! { "_id": 1 }, ..Find::default() };
            let ids: Vec<Bson> = self
                .stored(ns, &find)?
                .map(|document| {
                    Ok(Bson::try_from(document?.get("_id").map_err(QueryError::from)?.unwrap_or(RawBsonRef::Null))
                        .map_err(QueryError::from)?)
                })
                .collect::<Result<_, StoreError>>()?;
            match self.delete(ns, &doc! { "_id": { "$in": ids } }, false)? {
                0 => return Ok(removed),
                count => removed += count,
            }
        }
    }

    fn expire_collection(&self, ns: &Namespace, restart: bool) -> Result<Expired, StoreError> {
        let now = self.clock.now();
        let store = self.routes.of(ns)?;
        let remove = |filter: Document| {
            self.journal.note("expire", Some(ns), |n| *n, || store.delete(ns, (&filter).into(), false))
        };
        let mut expired = Expired {
            // Computed documents decay too: they are counted as what they are.
            computed: remove(doc! {
                // By the date of its decay, which has an index.
                metadata::DECAY_PATH: { "$lte": now },
                "_robmem_info.computed": true,
                "_robmem_info.cached_until": { "$lte": now },
            })?,
            decayed: remove(doc! { metadata::DECAY_PATH: { "$lte": now } })?,
            ..Expired::default()
        };
        for filter in store.indexes(ns)?.iter().filter_map(|index| due(index, now)) {
            expired.due += remove(filter)?;
        }
        if restart {
            expired.not_persistent = remove(doc! { "_robmem_info.persistent": false })?;
        }
        Ok(expired)
    }
}

/// What is due by an index that a user created.
fn due(index: &Index, now: DateTime) -> Option<Document> {
    before(index, now).filter(|_| index.name != index::DECAY)
}

/// What is due by an index.
fn before(index: &Index, now: DateTime) -> Option<Document> {
    let (path, latest) = index.expiring(now)?;
    Some(doc! { path: { "$lte": latest } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::embedded::Embedded;

    #[test]
    fn what_an_index_expires_goes_without_a_write() {
        let memory = Memory::new(Box::new(Embedded::in_memory().unwrap()), None, Vec::new());
        let ns = Namespace::parse("robmem.seen").unwrap();
        let date = |millis: i64| DateTime::from_millis(DateTime::now().timestamp_millis() + millis);
        let documents = vec![doc! { "_id": 1, "at": date(-3_600_000) }, doc! { "_id": 2, "at": date(3_600_000) }];
        memory.insert(&ns, documents).unwrap();
        memory.create_index(&ns, &Index { expire_after: Some(60), ..Index::on(doc! { "at": 1 }) }).unwrap();
        memory.expire_due().unwrap();
        let left: Vec<Bson> = memory.distinct(&ns, "_id", &Document::new()).unwrap();
        assert_eq!(left, [Bson::Int32(2)]);
    }

    #[cfg(feature = "mongodb")]
    #[test]
    fn what_runs_for_long_does_not_wait_for_a_server_that_is_away() {
        let away = "mongodb://127.0.0.1:1/?serverSelectionTimeoutMS=10";
        let uri = |text: &str| crate::store::StoreUri::parse(text).unwrap();
        let memory = Memory::at(uri("mem:"), uri(away), vec!["team".to_owned()]);
        memory.insert(&Namespace::parse("a.b").unwrap(), vec![doc! { "_id": 1 }]).unwrap();
        memory.limit_caches(1 << 20).unwrap();
        memory.expire_due().unwrap();
        memory.fold().unwrap();
        assert!(memory.kept_scopes().unwrap().is_empty());
        assert_eq!(memory.collections_of("a").unwrap().len(), 1);
        assert!(memory.collections().is_err() && memory.check_shared().is_err() && memory.check_local().is_ok());
    }
}
