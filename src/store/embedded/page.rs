//! What can go wrong while a page of documents or changes is read.

use super::damage::Damage;
use crate::query::QueryError;

/// Why a page cannot be read.
pub(super) enum PageError {
    /// SQLite failed.
    Store(rusqlite::Error),
    /// An expression in the filter failed on a document.
    Query(QueryError),
    /// A document is damaged: how, and its `_id`, as far as it can be read.
    Damaged(Damage, Option<String>),
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
