//! What can go wrong while a page of documents or changes is read.

use crate::query::QueryError;

/// Why a page cannot be read.
pub(super) enum PageError {
    /// SQLite failed.
    Store(rusqlite::Error),
    /// A document is malformed, or an expression in the filter failed on it.
    Query(QueryError),
}

impl From<rusqlite::Error> for PageError {
    fn from(error: rusqlite::Error) -> Self {
        Self::Store(error)
    }
}

impl From<QueryError> for PageError {
    fn from(error: QueryError) -> Self {
        Self::Query(error)
    }
}
