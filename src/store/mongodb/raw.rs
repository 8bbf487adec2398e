//! A server through the driver alone: the reference of the benchmark.

use bson::{Document, RawDocumentBuf, doc};
use mongodb::options::{Acknowledgment, ClientOptions, WriteConcern};
use mongodb::sync::{Client, Collection};

use super::failure;
use crate::store::{Namespace, StoreError};

/// A collection as a program without rmem uses it, with journaled writes.
pub struct Raw {
    collection: Collection<RawDocumentBuf>,
    address: String,
}

impl Raw {
    /// The collection `namespace` of the server at `uri`; `address` is what messages call it.
    ///
    /// # Errors
    /// Where the driver does not accept the URI.
    pub fn open(uri: &str, address: String, namespace: &Namespace) -> Result<Self, StoreError> {
        let explain = |error| failure::explain(&address, &error);
        let mut options = ClientOptions::parse(uri).run().map_err(explain)?;
        options.write_concern = Some(WriteConcern::builder().w(Acknowledgment::Nodes(1)).journal(true).build());
        let client = Client::with_options(options).map_err(explain)?;
        let collection = client.database(&namespace.database).collection(&namespace.collection);
        Ok(Self { collection, address })
    }

    fn explain(&self, error: &mongodb::error::Error) -> StoreError {
        failure::explain(&self.address, error)
    }

    /// Stores documents.
    ///
    /// # Errors
    /// Where the server cannot be reached or refuses.
    pub fn insert(&self, documents: Vec<Document>) -> Result<(), StoreError> {
        let encode = |document: Document| RawDocumentBuf::try_from(&document).map_err(crate::query::QueryError::from);
        let mut bodies = documents.into_iter().map(encode).collect::<Result<Vec<_>, _>>()?;
        let inserted = match bodies.len() {
            1 => self.collection.insert_one(bodies.remove(0)).run().map(drop),
            _ => self.collection.insert_many(bodies).run().map(drop),
        };
        inserted.map_err(|e| self.explain(&e))
    }

    /// Reads all matches; returns how many there were.
    ///
    /// # Errors
    /// Where the server cannot be reached or refuses.
    pub fn find(&self, filter: Document) -> Result<u64, StoreError> {
        let mut cursor = self.collection.find(filter).run().map_err(|e| self.explain(&e))?;
        cursor.try_fold(0, |count, document| document.map(|_| count + 1)).map_err(|e| self.explain(&e))
    }

    /// Reads what stages give; returns how many documents there were.
    ///
    /// # Errors
    /// Where the server cannot be reached or refuses.
    pub fn aggregate(&self, stages: Vec<Document>) -> Result<u64, StoreError> {
        let mut cursor = self.collection.aggregate(stages).run().map_err(|e| self.explain(&e))?;
        cursor.try_fold(0, |count, document| document.map(|_| count + 1)).map_err(|e| self.explain(&e))
    }

    /// Changes the first match.
    ///
    /// # Errors
    /// Where the server cannot be reached or refuses.
    pub fn update(&self, filter: Document, update: Document) -> Result<(), StoreError> {
        self.collection.update_one(filter, update).run().map(drop).map_err(|e| self.explain(&e))
    }

    /// Makes the index on names.
    ///
    /// # Errors
    /// Where the server cannot be reached or refuses.
    pub fn index(&self) -> Result<(), StoreError> {
        let index = mongodb::IndexModel::builder().keys(doc! { "name": 1 }).build();
        self.collection.create_index(index).run().map(drop).map_err(|e| self.explain(&e))
    }

    /// Removes the index on names.
    ///
    /// # Errors
    /// Where the server cannot be reached or refuses.
    pub fn drop_index(&self) -> Result<(), StoreError> {
        self.collection.drop_index("name_1").run().map_err(|e| self.explain(&e))
    }
}
