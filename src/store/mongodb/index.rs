//! Indexes, by the server's own commands, so that every option passes.

use bson::{Bson, DateTime, Document, doc};
use mongodb::error::Error;

use super::{MongoDb, failure};
use crate::query::QueryError;
use crate::store::{Index, IndexChange, Namespace, StoreError, index, metadata};

impl MongoDb {
    pub(super) fn make_index(&self, ns: &Namespace, index: &Index) -> Result<bool, StoreError> {
        let mut definition = index.definition();
        definition.remove("v");
        let command = doc! {
            "createIndexes": &ns.collection, "indexes": [definition], "writeConcern": { "w": "majority" },
        };
        let made = self.client().database(&ns.database).run_command(command).run();
        let made = made.map_err(|e| failure::explain_write(&self.address, ns, &e))?;
        let count = |key: &str| made.get_i32(key).unwrap_or_default();
        Ok(count("numIndexesAfter") > count("numIndexesBefore"))
    }

    /// Makes sure that the server removes what decays, where one of the
    /// documents does: by a TTL index on the dates, made with the first of them.
    pub(super) fn expect_decay<'a>(
        &self,
        ns: &Namespace,
        mut documents: impl Iterator<Item = &'a Document>,
    ) -> Result<(), StoreError> {
        if !documents.any(mentions_decay) || self.decaying.get(ns).is_some() {
            return Ok(());
        }
        self.make_index(ns, &Index::of_decay())?;
        self.decaying.learn(ns, ());
        Ok(())
    }

    /// Forgets what was known of a collection, which is gone.
    pub(super) fn forget(&self, ns: &Namespace) {
        self.decaying.forget(ns);
        self.collations.forget(ns);
        self.identities.forget(ns);
        self.forget_history(ns);
    }

    pub(super) fn discard_index(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        if name == index::DECAY {
            let message = format!("{name} is rmem's: by it what has decayed is found");
            return Err(QueryError::invalid(72, message).into());
        }
        let command = doc! { "dropIndexes": &ns.collection, "index": name, "writeConcern": { "w": "majority" } };
        match self.client().database(&ns.database).run_command(command).run() {
            Ok(_) => Ok(true),
            Err(error) if is_missing(&error) => Ok(false),
            Err(error) => Err(self.explain(&error)),
        }
    }

    pub(super) fn change_index(&self, ns: &Namespace, name: &str, change: IndexChange) -> Result<bool, StoreError> {
        let mut index = doc! { "name": name };
        index.extend(change.hidden.map(|hidden| ("hidden".to_owned(), hidden.into())));
        index.extend(change.expire_after.map(|seconds| ("expireAfterSeconds".to_owned(), seconds.into())));
        let command = doc! { "collMod": &ns.collection, "index": index, "writeConcern": { "w": "majority" } };
        match self.client().database(&ns.database).run_command(command).run() {
            Ok(_) => Ok(true),
            Err(error) if is_missing(&error) => Ok(false),
            Err(error) => Err(self.explain(&error)),
        }
    }

    /// Removes what has decayed and the server has not removed yet, so that its keys are free; returns whether there was any.
    pub(super) fn remove_decayed(&self, ns: &Namespace) -> Result<bool, StoreError> {
        if !self.list_indexes(ns)?.contains(&Index::of_decay()) {
            return Ok(false);
        }
        let decayed = doc! { metadata::DECAY_PATH: { "$lte": DateTime::now() } };
        let removed = self.collection(ns).delete_many(decayed).run();
        removed.map(|removed| removed.deleted_count > 0).map_err(|e| failure::explain_change(&self.address, ns, &e))
    }

    pub(super) fn list_indexes(&self, ns: &Namespace) -> Result<Vec<Index>, StoreError> {
        let command = doc! { "listIndexes": &ns.collection };
        let cursor = match self.client().database(&ns.database).run_cursor_command(command).run() {
            Err(error) if failure::code(&error) == Some(QueryError::NAMESPACE_NOT_FOUND) => return Ok(Vec::new()),
            cursor => cursor.map_err(|e| self.explain(&e))?,
        };
        cursor
            .map(|definition: Result<Document, Error>| Ok(Index::parse(&definition.map_err(|e| self.explain(&e))?)?))
            .collect()
    }
}

/// Whether a document, or an update, has a date of decay.
fn mentions_decay(document: &Document) -> bool {
    document.iter().any(|(key, value)| match value {
        _ if key == metadata::DECAY_PATH => true,
        Bson::Document(info) if key == metadata::INFO => info.contains_key(metadata::DECAY),
        Bson::Document(fields) if key.starts_with('$') => mentions_decay(fields),
        _ => false,
    })
}

/// Whether the server says that the collection, or the index, is not there.
fn is_missing(error: &Error) -> bool {
    matches!(failure::code(error), Some(QueryError::NAMESPACE_NOT_FOUND | QueryError::INDEX_NOT_FOUND))
}
