//! Storing documents: one transaction per batch.

use bson::{Bson, Document, RawDocument};
use rusqlite::params;

use super::catalog::Collection;
use super::change_log::Noted;
use super::{Embedded, body as stored, failure};
use crate::query::key;
use crate::store::{Inserted, Namespace, StoreError, TakenKey, document};

impl Embedded {
    /// Stores the documents up to the first that is not acceptable or whose
    /// key is taken; those before it stay. Where storing as such fails, none does.
    pub(super) fn insert_batch(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        let count = documents.len();
        if count == 0 {
            return Ok(Inserted::default());
        }
        let mut stored = Vec::with_capacity(count);
        let refusal = self.write(|| {
            let collection = self.ensure(ns)?;
            self.sweep_for(ns, collection, count)?;
            for document in documents {
                let added = document::settle(document)
                    .map_err(StoreError::from)
                    .and_then(|(id, body)| self.add(ns, collection, &id, &body).map(|()| id));
                match added {
                    Ok(id) => stored.push(id),
                    // What was stored before stays.
                    Err(refusal) if is_refusal(&refusal) && !stored.is_empty() => return Ok(Some(refusal)),
                    Err(error) => return Err(error),
                }
            }
            Ok(None)
        });
        match refusal {
            Ok(None) => Ok(Inserted { ids: stored }),
            Ok(Some(refusal)) => Err(refusal.stopped(stored, count)),
            Err(refusal) if is_refusal(&refusal) => Err(refusal.stopped(Vec::new(), count)),
            Err(failure) => Err(failure),
        }
    }

    /// Adds a settled document. In a write transaction only.
    ///
    /// A unique key of a document that has decayed or expired is free: such documents are removed first.
    pub(super) fn add(
        &self,
        ns: &Namespace,
        collection: Collection,
        id: &Bson,
        body: &RawDocument,
    ) -> Result<(), StoreError> {
        match self.add_at_once(ns, collection, id, body) {
            Err(StoreError::Duplicate { .. }) if self.sweep_all(ns, collection)? => {
                self.add_at_once(ns, collection, id, body)
            }
            added => added,
        }
    }

    fn add_at_once(
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
        let indexes = self.expect_decay(ns, collection, self.indexes_of(collection)?, body)?;
        self.check_valid(ns, &indexes, body, None)?;
        let entries = self.entries(ns, &indexes, body, None)?;
        let sql = format!("INSERT INTO {} (key, body) VALUES (?, ?)", collection.table());
        let inserted = self
            .connection
            .prepare_cached(&sql)
            .and_then(|mut statement| statement.execute(params![key, stored::seal(body)]));
        match inserted {
            Ok(_) => {
                let position = self.connection.last_insert_rowid();
                self.add_entries(collection, &indexes, position, &entries)?;
                self.note(ns, Noted::insert(body, position))
            }
            Err(error) if failure::is_duplicate(&error) => {
                Err(StoreError::Duplicate { namespace: ns.clone(), key: TakenKey::id(id), stored: Vec::new() })
            }
            Err(error) => Err(self.explain(&error)),
        }
    }
}

/// Whether an error is about a document, which is refused, and not about the store.
fn is_refusal(error: &StoreError) -> bool {
    matches!(error, StoreError::Duplicate { .. } | StoreError::Invalid(_) | StoreError::Query(_))
}
