//! The operations of [`Store`], each in a few lines.

use bson::{Bson, Document};

use super::catalog::Collection;
use super::language::Filter;
use super::scan::Scan;
use super::{Embedded, failure};
use crate::query::QueryError;
use crate::store::{Documents, Find, Inserted, Namespace, Store, StoreError, UpdateRequest, Updated};

impl Store for Embedded {
    fn insert(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        self.insert_batch(ns, documents)
    }

    fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        let filter = Filter::parse(&find.filter)?;
        if !find.sort.is_empty() || !find.projection.is_empty() {
            return Err(QueryError::unsupported("sort").into());
        }
        let Some(collection) = self.collection(ns)? else { return Ok(Box::new(std::iter::empty())) };
        let skip = usize::try_from(find.skip).unwrap_or(usize::MAX);
        let limit = if find.limit == 0 { usize::MAX } else { usize::try_from(find.limit).unwrap_or(usize::MAX) };
        let scan = Scan::new(self, collection, filter);
        Ok(Box::new(scan.map(|found| found.map(|found| found.body)).skip(skip).take(limit)))
    }

    fn count(&self, ns: &Namespace, filter: &Document) -> Result<u64, StoreError> {
        let filter = Filter::parse(filter)?;
        let Some(collection) = self.collection(ns)? else { return Ok(0) };
        let mut count = 0;
        for found in Scan::new(self, collection, filter) {
            found?;
            count += 1;
        }
        Ok(count)
    }

    fn distinct(&self, _: &Namespace, _: &str, _: &Document) -> Result<Vec<Bson>, StoreError> {
        Err(QueryError::unsupported("distinct").into())
    }

    fn aggregate(&self, _: &Namespace, _: &[Document]) -> Result<Documents<'_>, StoreError> {
        Err(QueryError::unsupported("aggregate").into())
    }

    fn update(&self, _: &Namespace, _: &UpdateRequest) -> Result<Updated, StoreError> {
        Err(QueryError::unsupported("update").into())
    }

    fn delete(&self, ns: &Namespace, filter: &Document, first_only: bool) -> Result<u64, StoreError> {
        let filter = Filter::parse(filter)?;
        self.write(|| {
            let Some(collection) = self.collection(ns)? else { return Ok(0) };
            let sql = format!("DELETE FROM {} WHERE position = ?", collection.table());
            let mut statement = self.connection.prepare_cached(&sql).map_err(|e| self.explain(&e))?;
            let mut deleted = 0;
            for found in Scan::new(self, collection, filter).take(if first_only { 1 } else { usize::MAX }) {
                statement.execute([found?.position]).map_err(|e| self.explain(&e))?;
                deleted += 1;
            }
            Ok(deleted)
        })
    }

    fn drop(&self, ns: &Namespace) -> Result<bool, StoreError> {
        self.write(|| match self.collection(ns)? {
            Some(collection) => collection.drop(&self.connection).map(|()| true).map_err(|e| self.explain(&e)),
            None => Ok(false),
        })
    }

    fn collections(&self) -> Result<Vec<Namespace>, StoreError> {
        Collection::all(&self.connection).map_err(|e| self.explain(&e))
    }

    fn describe(&self) -> String {
        self.place.to_string()
    }
}

impl Embedded {
    /// Runs `work` in a write transaction: all of it is kept, or, where it fails, nothing.
    pub(super) fn write<T>(&self, work: impl FnOnce() -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.run("BEGIN IMMEDIATE")?;
        let result = work().and_then(|value| self.run("COMMIT").map(|()| value));
        if result.is_err() && !self.connection.is_autocommit() {
            // A failing rollback leaves nothing to do: closing rolls back too.
            let _ = self.run("ROLLBACK");
        }
        result
    }

    fn run(&self, sql: &str) -> Result<(), StoreError> {
        self.connection
            .prepare_cached(sql)
            .and_then(|mut statement| statement.execute([]))
            .map(|_| ())
            .map_err(|e| self.explain(&e))
    }

    fn collection(&self, ns: &Namespace) -> Result<Option<Collection>, StoreError> {
        Collection::find(&self.connection, ns).map_err(|e| self.explain(&e))
    }

    pub(super) fn explain(&self, error: &rusqlite::Error) -> StoreError {
        failure::explain(&self.place, error)
    }

    pub(super) fn fail(&self, reason: &str) -> StoreError {
        StoreError::Failed { address: self.place.to_string(), reason: reason.to_owned() }
    }
}
