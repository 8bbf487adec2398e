//! Which documents match.
use super::error::{QueryError, Result};
use bson::{Bson, Document, RawDocument};

/// A compiled filter.
#[derive(Debug)]
pub struct Filter {}

impl Filter {
    /// Reads a filter.
    ///
    /// # Errors
    /// Where MongoDB refuses it, or rmem does not support an operator.
    pub fn parse(_filter: &Document) -> Result<Self> {
        Err(QueryError::unsupported("filter"))
    }

    /// Whether a document matches.
    ///
    /// # Errors
    /// Where an expression of the filter fails on the document.
    pub fn matches(&self, _document: &RawDocument) -> Result<bool> {
        Err(QueryError::unsupported("filter"))
    }

    /// The only values of `_id` that a match can have, where the filter says so:
    /// an index may be asked for them. The filter must still be applied.
    #[must_use]
    pub fn ids(&self) -> Option<Vec<Bson>> {
        None
    }
}
