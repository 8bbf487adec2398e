//! Streams of documents between the stages of a pipeline, and where they come from.

use bson::{Document, RawDocumentBuf};

use crate::query::error::Result;
use crate::query::limit::encode_between;

/// A stream of documents, which ends with the first error.
pub type Documents<'a, E> = Box<dyn Iterator<Item = std::result::Result<RawDocumentBuf, E>> + 'a>;

/// Returns the documents of another collection, in natural order.
pub type Sources<'a, E> = dyn Fn(&Origin) -> std::result::Result<Documents<'a, E>, E> + 'a;

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
    let mut compute = Some(compute);
    let mut ready = Vec::new().into_iter();
    Box::new(std::iter::from_fn(move || {
        if let Some(compute) = compute.take() {
            match compute() {
                Ok(documents) => ready = documents.into_iter(),
                Err(error) => return Some(Err(error)),
            }
        }
        ready.next().map(Ok)
    }))
}

/// Encodes a document.
pub(super) fn encode(document: &Document) -> Result<RawDocumentBuf> {
    encode_between(document)
}
