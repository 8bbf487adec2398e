//! Which fields of a match are given.
use super::error::{QueryError, Result};
use super::filter::Filter;
use bson::{DateTime, Document, RawDocument, RawDocumentBuf};

/// A compiled projection.
#[derive(Debug)]
pub struct Projection {}

impl Projection {
    /// Reads a projection as `find` takes it.
    ///
    /// # Errors
    /// Where MongoDB refuses it.
    pub fn parse(_projection: &Document) -> Result<Self> {
        Err(QueryError::unsupported("projection"))
    }

    /// The projected document. `filter` is the one the document matched, for the positional `$`.
    ///
    /// # Errors
    /// Where an expression fails on the document.
    pub fn apply(&self, _document: &RawDocument, _filter: &Filter, _now: DateTime) -> Result<RawDocumentBuf> {
        Err(QueryError::unsupported("projection"))
    }
}
