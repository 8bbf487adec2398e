//! Streams of documents between the stages of a pipeline, and where they come from.

use bson::{Document, RawDocumentBuf};

use crate::query::error::{QueryError, Result};
use crate::query::interruption;
use crate::query::limit::encode_between;

/// A stream of documents, which ends with the first error.
pub type Documents<'a, E> = Box<dyn Iterator<Item = std::result::Result<RawDocumentBuf, E>> + 'a>;

/// Returns the documents of another collection, in natural order; those that match a filter where an index finds them,
/// else nothing.
pub type Sources<'a, E> = dyn Fn(&Origin, Option<&Document>) -> std::result::Result<Option<Documents<'a, E>>, E> + 'a;

/// A collection that a stage names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    /// The database, where the stage names one; else that of the pipeline.
    pub database: Option<String>,
    /// The collection.
    pub collection: String,
}

/// Returns a stream whose documents are computed all at once when the first one is requested.
pub(super) fn deferred<'a, E: 'a>(
    compute: impl FnOnce() -> std::result::Result<Vec<RawDocumentBuf>, E> + 'a,
) -> Documents<'a, E> {
    lazy(move || Ok(Box::new(compute()?.into_iter().map(Ok))))
}

/// Returns a stream that is begun when the first document is requested.
pub(super) fn lazy<'a, E: 'a>(
    begin: impl FnOnce() -> std::result::Result<Documents<'a, E>, E> + 'a,
) -> Documents<'a, E> {
    let mut begin = Some(begin);
    let mut ready: Documents<'a, E> = Box::new(std::iter::empty());
    Box::new(std::iter::from_fn(move || {
        if let Some(begin) = begin.take() {
            match begin() {
                Ok(documents) => ready = documents,
                Err(error) => return Some(Err(error)),
            }
        }
        ready.next()
    }))
}

/// Returns a stream that fails where the operation is to end.
pub(super) fn interruptible<'a, E: From<QueryError> + 'a>(documents: Documents<'a, E>) -> Documents<'a, E> {
    Box::new(documents.map(|document| {
        interruption::check()?;
        document
    }))
}

/// Encodes a document.
pub(super) fn encode(document: &Document) -> Result<RawDocumentBuf> {
    encode_between(document)
}
