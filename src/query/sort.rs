//! In which order.
use super::error::{QueryError, Result};
use bson::{Document, RawDocumentBuf};

/// A compiled sort pattern.
#[derive(Debug)]
pub struct Sort {}

impl Sort {
    /// Reads a pattern like `{a: 1, "b.c": -1}`.
    ///
    /// # Errors
    /// Where a direction is not 1 or -1.
    pub fn parse(_pattern: &Document) -> Result<Self> {
        Err(QueryError::unsupported("sort"))
    }

    /// Whether the pattern is empty: natural order.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        true
    }

    /// The documents in order, at most `limit` of them; stable.
    ///
    /// # Errors
    /// The first error of the input, or parallel arrays.
    pub fn sort<E: From<QueryError>>(
        &self,
        _documents: impl Iterator<Item = std::result::Result<RawDocumentBuf, E>>,
        _limit: Option<usize>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        Err(QueryError::unsupported("sort").into())
    }
}
