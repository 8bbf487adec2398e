//! `$collStats` and `$indexStats`: what is known of a collection, as the documents that a pipeline begins with.

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::Embedded;
use super::catalog::Collection;
use crate::query::{Description, QueryError};
use crate::saturate::to_i64;
use crate::store::{Namespace, StoreError};

/// What stands for the name of a host: a file is on none.
const HOST: &str = "rmem";
/// MongoDB's code for a collection that is not there.
const NO_COLLECTION: i32 = 26;

impl Embedded {
    /// The documents that describe a collection.
    pub(super) fn described(
        &self,
        ns: &Namespace,
        description: Description,
    ) -> Result<Vec<RawDocumentBuf>, StoreError> {
        let documents = match description {
            Description::Indexes => self.index_statistics(ns)?,
            Description::Collection { scale, count } => vec![self.collection_statistics(ns, scale, count)?],
        };
        let raw = |document: &Document| Ok(RawDocumentBuf::try_from(document).map_err(QueryError::from)?);
        documents.iter().map(raw).collect()
    }

    fn index_statistics(&self, ns: &Namespace) -> Result<Vec<Document>, StoreError> {
        let now = DateTime::now();
        let of = |index: &crate::store::Index| {
            doc! {
                "name": &index.name,
                "key": index.keys.clone(),
                "host": HOST,
                "accesses": { "ops": 0_i64, "since": now },
                "spec": index.definition(),
            }
        };
        Ok(self.list_indexes(ns)?.iter().map(of).collect())
    }

    fn collection_statistics(&self, ns: &Namespace, scale: Option<i64>, count: bool) -> Result<Document, StoreError> {
        let mut statistics = doc! { "ns": ns.to_string(), "host": HOST, "localTime": DateTime::now() };
        if scale.is_none() && !count {
            return Ok(statistics);
        }
        let Some(collection) = self.collection(ns)? else {
            return Err(QueryError::invalid(NO_COLLECTION, format!("there is no collection {ns}")).into());
        };
        let documents = collection.size(&self.connection).map_err(|e| self.explain(&e))?.cast_signed();
        if let Some(scale) = scale {
            statistics.insert("storageStats", self.storage_statistics(ns, collection, documents, scale)?);
        }
        if count {
            statistics.insert("count", number(documents));
        }
        Ok(statistics)
    }

    fn storage_statistics(
        &self,
        ns: &Namespace,
        collection: Collection,
        documents: i64,
        scale: i64,
    ) -> Result<Document, StoreError> {
        let mut size = 0;
        for document in self.matches(ns, &Document::new())? {
            size += to_i64(document?.as_bytes().len());
        }
        let stored = collection.bytes(&self.connection).map_err(|e| self.explain(&e))?;
        let sizes = self.sizes(collection)?;
        let all: i64 = sizes.iter().map(|(_, bytes)| bytes).sum();
        let sizes: Document = sizes.into_iter().map(|(name, bytes)| (name, number(bytes / scale))).collect();
        let mut statistics = doc! { "size": number(size / scale), "count": number(documents) };
        if documents > 0 {
            statistics.insert("avgObjSize", number(size / documents));
        }
        statistics.extend(doc! {
            "numOrphanDocs": 0,
            "storageSize": number(stored / scale),
            "freeStorageSize": 0,
            "capped": false,
            "nindexes": number(to_i64(sizes.len())),
            "indexBuilds": [],
            "totalIndexSize": number(all / scale),
            "totalSize": number((stored + all) / scale),
            "indexSizes": sizes,
            "scaleFactor": number(scale),
        });
        Ok(statistics)
    }
}

impl Embedded {
    /// The bytes of the keys and positions of each index, that on `_id` first.
    pub(super) fn sizes(&self, collection: Collection) -> Result<Vec<(String, i64)>, StoreError> {
        let bytes = |table: &str| {
            let sql = format!("SELECT coalesce(sum(length(key) + 8), 0) FROM {table}");
            self.connection.query_row(&sql, [], |row| row.get(0)).map_err(|e| self.explain(&e))
        };
        let mut sizes = vec![(crate::store::index::ID.to_owned(), bytes(&collection.table())?)];
        for index in self.indexes_of(collection)?.iter() {
            let bytes = if index.is_kept() { bytes(&index.table())? } else { 0 };
            sizes.push((index.definition.name.clone(), bytes));
        }
        Ok(sizes)
    }
}

/// A number of 32 bits where that is enough.
fn number(value: i64) -> Bson {
    i32::try_from(value).map_or(Bson::Int64(value), Bson::Int32)
}
