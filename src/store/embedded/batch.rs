//! Storing documents: one transaction per batch.

use bson::{Bson, Document, RawDocument};
use rusqlite::params;

use super::catalog::Collection;
use super::{Embedded, failure};
use crate::query::key;
use crate::store::{Inserted, Namespace, StoreError, document};

impl Embedded {
    /// Stores the documents up to the first whose key is taken; those before it stay.
    pub(super) fn insert_batch(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        let documents = document::settle_all(documents)?;
        let mut stored = Vec::with_capacity(documents.len());
        if documents.is_empty() {
            return Ok(Inserted { ids: stored });
        }
        let taken = self.write(|| {
            let collection = Collection::ensure(&self.connection, ns).map_err(|e| self.explain(&e))?;
            for (id, body) in documents {
                match self.add(ns, collection, &id, &body) {
                    Ok(()) => stored.push(id),
                    Err(StoreError::Duplicate { key, .. }) => return Ok(Some(key)),
                    Err(failure) => return Err(failure),
                }
            }
            Ok(None)
        })?;
        match taken {
            None => Ok(Inserted { ids: stored }),
            Some(key) => Err(StoreError::Duplicate { namespace: ns.clone(), key, stored }),
        }
    }

    /// Adds a settled document. In a write transaction only.
    pub(super) fn add(
        &self,
        ns: &Namespace,
        collection: Collection,
        id: &Bson,
        body: &RawDocument,
    ) -> Result<(), StoreError> {
        let key = match body.get("_id") {
            Ok(Some(id)) => key::encode(id),
            _ => return Err(self.fail("a document without an _id was to be stored")),
        };
        let sql = format!("INSERT INTO {} (key, body) VALUES (?, ?)", collection.table());
        let inserted = self
            .connection
            .prepare_cached(&sql)
            .and_then(|mut statement| statement.execute(params![key, body.as_bytes()]));
        match inserted {
            Ok(_) => Ok(()),
            Err(error) if failure::is_duplicate(&error) => {
                Err(StoreError::Duplicate { namespace: ns.clone(), key: format!("_id: {}", id), stored: Vec::new() })
            }
            Err(error) => Err(self.explain(&error)),
        }
    }
}
