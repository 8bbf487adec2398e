//! Documents of a dump, stored some at a time.

use bson::{Document, RawDocumentBuf};

use crate::store::metadata;

/// At most so many documents are stored at once …
const BATCH: usize = 2_000;
/// … and about so many bytes.
const BATCH_BYTES: usize = 1 << 20;

/// Returns the documents in batches of at most [`BATCH`] documents and about [`BATCH_BYTES`] bytes.
pub(super) fn batches<E>(
    mut documents: impl Iterator<Item = Result<Document, E>>,
) -> impl Iterator<Item = Result<Vec<Document>, E>> {
    std::iter::from_fn(move || {
        let (mut batch, mut bytes) = (Vec::new(), 0);
        while batch.len() < BATCH && bytes < BATCH_BYTES {
            match documents.next() {
                None => break,
                Some(Err(error)) => return Some(Err(error)),
                Some(Ok(document)) => {
                    bytes += RawDocumentBuf::try_from(&document).map_or(0, |raw| raw.as_bytes().len());
                    batch.push(document);
                }
            }
        }
        (!batch.is_empty()).then_some(Ok(batch))
    })
}

/// Returns the documents without the dates at which they were inserted and updated.
pub(super) fn undated(mut batch: Vec<Document>) -> Vec<Document> {
    batch.iter_mut().for_each(metadata::forget_dates);
    batch
}
