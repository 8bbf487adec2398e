//! How documents change.
use super::error::{QueryError, Result};
use super::filter::Filter;
use bson::{DateTime, Document, RawDocument, RawDocumentBuf};

/// A compiled update.
#[derive(Debug)]
pub struct Update {}

impl Update {
    /// Reads operators, or a replacement document, which is one without operators.
    ///
    /// # Errors
    /// Where MongoDB refuses it.
    pub fn parse(_update: &Document, _array_filters: &[Document]) -> Result<Self> {
        Err(QueryError::unsupported("update"))
    }

    /// Reads an update in pipeline form.
    ///
    /// # Errors
    /// Where MongoDB refuses it.
    pub fn parse_pipeline(_stages: &[Document]) -> Result<Self> {
        Err(QueryError::unsupported("update"))
    }

    /// Whether it is a replacement document, which MongoDB refuses for many documents.
    #[must_use]
    pub fn is_replacement(&self) -> bool {
        false
    }

    /// The changed document, or nothing where it would stay the same. `filter`
    /// is the one the document matched, for the positional `$`.
    ///
    /// # Errors
    /// Where the update cannot be applied to this document.
    pub fn apply(&self, _document: &RawDocument, _filter: &Filter, _now: DateTime) -> Result<Option<RawDocumentBuf>> {
        Err(QueryError::unsupported("update"))
    }

    /// The document to insert where nothing matched `filter`. It has an `_id`
    /// first, a new ObjectId where neither filter nor update names one.
    ///
    /// # Errors
    /// Where the update cannot be applied to the filter's equalities.
    pub fn upsert(&self, _filter: &Document, _now: DateTime) -> Result<RawDocumentBuf> {
        Err(QueryError::unsupported("update"))
    }
}
