//! The condition that documents are as they were read.

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::dates::path;
use super::prediction::Before;
use crate::query::QueryError;
use crate::store::metadata::{INFO, INSERTED, UPDATED};

/// The largest document, in bytes, that is compared as a whole.
const LARGEST_CONDITION: usize = 1 << 20;

/// The condition that documents are as they were read: one as a whole; of several, that each was changed last when one of
/// them was.
pub(super) fn as_they_were(before: &Before) -> Result<Document, QueryError> {
    if let [(_, body)] = before.as_slice() {
        return as_read(body);
    }
    let mut last = Vec::with_capacity(before.len());
    for (_, body) in before {
        last.push(updated(body)?.map_or(Bson::Null, Bson::from));
    }
    last.dedup();
    Ok(doc! { path(UPDATED): { "$in": last } })
}

/// The condition that a document is as it was read, as far as a command can say that.
pub(super) fn as_read(document: &RawDocumentBuf) -> Result<Document, QueryError> {
    let known = Document::try_from(&**document)?;
    // One with a field twice cannot be written as an expression, and a large one not beside the update.
    if document.as_bytes().len() > LARGEST_CONDITION || RawDocumentBuf::try_from(&known)? != *document {
        return with_the_same_metadata(document);
    }
    Ok(doc! { "$expr": { "$eq": ["$$ROOT", { "$literal": known }] } })
}

/// The condition that the metadata of a document are those that were read: rmem writes a date wherever it changes something.
pub(super) fn with_the_same_metadata(document: &RawDocumentBuf) -> Result<Document, QueryError> {
    let info = document.get(INFO)?.map(Bson::try_from).transpose()?;
    Ok(info.map_or_else(|| doc! { INFO: { "$exists": false } }, |info| doc! { INFO: { "$eq": info } }))
}

/// When a document was changed last.
pub(super) fn updated(document: &RawDocumentBuf) -> Result<Option<DateTime>, QueryError> {
    Ok(dates(document)?.get_datetime(UPDATED).ok().copied())
}

/// The dates of a document.
pub(super) fn dates(document: &RawDocumentBuf) -> Result<Document, QueryError> {
    let info = document.get(INFO)?.and_then(|info| info.as_document());
    let mut dates = Document::new();
    for key in [INSERTED, UPDATED] {
        if let Some(value) = info.map(|info| info.get(key)).transpose()?.flatten() {
            dates.insert(key, Bson::try_from(value)?);
        }
    }
    Ok(dates)
}
