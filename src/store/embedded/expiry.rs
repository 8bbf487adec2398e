//! Removing documents that have decayed or that a TTL index has expired.
//!
//! There is no background process, so writers do it: each insert and update first removes
//! a few of the longest expired documents of its collection, an insert of many as many as it
//! adds. (A delete does not, since it counts what it removes. Nor does an update of rmem's own
//! collections, which may be about what has just expired.)

use bson::{Bson, DateTime, doc};
use rusqlite::{OptionalExtension as _, params};

use super::catalog::Collection;
use super::indexed::Indexed;
use super::keys::Keys;
use super::scan::Found;
use super::{Embedded, failure};
use crate::query::index::{Candidate, Range, ways};
use crate::query::{Filter, QueryError, Sort};
use crate::store::{Namespace, StoreError};

/// How many expired documents a write removes at most, for each index.
const AT_ONCE: usize = 64;

impl Embedded {
    /// Removes some expired documents. In a write transaction only, before what is to be written.
    pub(super) fn sweep(&self, ns: &Namespace, collection: Collection) -> Result<(), StoreError> {
        self.remove_due(ns, collection).map(drop)
    }

    /// Removes expired documents, about as many as are to be added, so that they do not get more and more.
    /// In a write transaction only.
    pub(super) fn sweep_for(&self, ns: &Namespace, collection: Collection, added: usize) -> Result<(), StoreError> {
        for _ in 0..=added / AT_ONCE {
            if !self.remove_due(ns, collection)? {
                break;
            }
        }
        Ok(())
    }

    /// Removes all expired documents; returns whether there were any. In a write transaction only.
    pub(super) fn sweep_all(&self, ns: &Namespace, collection: Collection) -> Result<bool, StoreError> {
        let mut removed = false;
        while self.remove_due(ns, collection)? {
            removed = true;
        }
        Ok(removed)
    }

    /// Removes the longest expired documents by each index; returns whether there were any.
    fn remove_due(&self, ns: &Namespace, collection: Collection) -> Result<bool, StoreError> {
        let mut removed = false;
        for index in self.indexes_of(collection)?.iter().filter(|index| index.is_kept()) {
            let Some((path, latest)) = index.definition.expiring(DateTime::now()) else { continue };
            for range in due(index, path, latest)? {
                for found in self.first_of(collection, index, &range)? {
                    self.erase(ns, collection, &found)?;
                    removed = true;
                }
            }
        }
        Ok(removed)
    }

    /// The documents with the first keys of a range.
    fn first_of(&self, collection: Collection, index: &Indexed, range: &Range) -> Result<Vec<Found>, StoreError> {
        // A limit that is bound, and rows that are compared, would make SQLite prepare the statement anew each time.
        let listed = index.keys();
        let keys = format!(
            "SELECT key, position, {} FROM {} WHERE key >= ? AND key < ? LIMIT {AT_ONCE}",
            listed.seals(),
            listed.table
        );
        let body = format!("SELECT body FROM {} WHERE position = ?", collection.table());
        let read = || -> rusqlite::Result<Vec<(i64, Vec<u8>)>> {
            let mut statement = self.connection.prepare_cached(&keys)?;
            let listed = statement.query_map(params![range.low, range.high], |row| Keys::position(row, 2))?;
            let mut positions: Vec<i64> = Vec::new();
            for position in listed {
                let position = position?;
                if !positions.contains(&position) {
                    positions.push(position);
                }
            }
            let mut rows = Vec::with_capacity(positions.len());
            for position in positions {
                let mut statement = self.connection.prepare_cached(&body)?;
                let found = statement.query_row([position], |row| row.get(0)).optional()?;
                // Within a transaction, what is listed is there.
                rows.push((position, found.ok_or_else(failure::no_document)?));
            }
            Ok(rows)
        };
        let rows = read().map_err(|e| self.explain(&e))?;
        rows.into_iter()
            .map(|(position, stored)| Ok(Found { position, body: self.opened(collection, &stored)? }))
            .collect()
    }
}

/// The keys of documents whose date at `path` is at or before `date`.
fn due(index: &Indexed, path: &str, date: DateTime) -> Result<Vec<Range>, QueryError> {
    let filter = Filter::parse(&doc! { path: { "$lte": Bson::DateTime(date) } })?;
    let candidate = Candidate { pattern: &index.pattern, multikey: index.multikey(), sparse: index.definition.sparse };
    Ok(ways(&filter, &Sort::none(), &[candidate]).pop().map(|way| way.ranges).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Index, Store as _};

    #[test]
    fn expired_documents_do_not_outgrow_what_is_added() {
        let store = Embedded::in_memory().unwrap();
        let ns = Namespace::parse("a.b").unwrap();
        store.create_index(&ns, &Index { expire_after: Some(0), ..Index::on(doc! { "until": 1 }) }).unwrap();
        let over = DateTime::from_millis(DateTime::now().timestamp_millis() - 60_000);
        let rows = || {
            let table = store.collection(&ns).unwrap().unwrap().table();
            let count = format!("SELECT count(*) FROM {table}");
            store.connection.query_row(&count, [], |row| row.get::<_, i64>(0)).unwrap()
        };
        for _ in 0..3 {
            store.insert(&ns, (0..1_000).map(|_| doc! { "until": over }).collect()).unwrap();
            assert_eq!(rows(), 1_000);
        }
        store.insert(&ns, vec![doc! {}]).unwrap();
        assert_eq!(rows(), 1_001 - i64::try_from(AT_ONCE).unwrap(), "one document does not pay for all");
    }
}
