//! The condition that a document is as it was read.

use bson::{Bson, Document, RawDocumentBuf, doc};

use crate::query::QueryError;
use crate::store::metadata::{INFO, INSERTED, UPDATED};
use crate::store::{UpdateRequest, UpdateSpec};

/// The largest document, in bytes, that is compared as a whole.
const LARGEST_CONDITION: usize = 1 << 20;
/// How many bytes there are for the documents of a command, of the 16 MiB that it has, and some for the rest of it.
pub(super) const LARGEST_COMMAND: usize = (16 << 20) - (2 << 10);

/// The condition that a document is as it was read, as far as a command can say that beside the request.
pub(super) fn as_read(document: &RawDocumentBuf, request: &UpdateRequest) -> Result<Document, QueryError> {
    let known = Document::try_from(&**document)?;
    let room = LARGEST_COMMAND.saturating_sub(size(request)?);
    // One with a field twice cannot be written as an expression.
    if document.as_bytes().len() > LARGEST_CONDITION.min(room) || RawDocumentBuf::try_from(&known)? != *document {
        return with_the_same_metadata(document);
    }
    Ok(doc! { "$expr": { "$eq": ["$$ROOT", { "$literal": known }] } })
}

/// Whether a request fits into a command.
pub(super) fn fits(request: &UpdateRequest) -> Result<bool, QueryError> {
    Ok(size(request)? <= LARGEST_COMMAND)
}

/// How many bytes a request has without the names of its parts.
fn size(request: &UpdateRequest) -> Result<usize, QueryError> {
    let UpdateRequest { filter, update, array_filters, .. } = request;
    let documents = match update {
        UpdateSpec::Document(document) => std::slice::from_ref(document),
        UpdateSpec::Pipeline(stages) => stages,
    };
    let mut size = 0;
    for document in documents.iter().chain(array_filters).chain([filter]) {
        size += RawDocumentBuf::try_from(document)?.as_bytes().len();
    }
    Ok(size)
}

/// The condition that the metadata of a document are those that were read: rmem writes a date wherever it changes something.
pub(super) fn with_the_same_metadata(document: &RawDocumentBuf) -> Result<Document, QueryError> {
    let info = document.get(INFO)?.map(Bson::try_from).transpose()?;
    Ok(info.map_or_else(|| doc! { INFO: { "$exists": false } }, |info| doc! { INFO: { "$eq": info } }))
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
