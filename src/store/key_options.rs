//! What a `find` says of the keys of an index: between which of them it reads, and whether it returns them.

use bson::raw::{CStr, cstr};
use bson::{Document, RawDocumentBuf};

use crate::query::QueryError;

/// MongoDB's code for bounds of different fields.
const DIFFERENT_FIELDS: i32 = 51_176;

/// The field that a place in a collection is shown in.
pub(crate) const RECORD_ID: &CStr = cstr!("$recordId");

/// The options `min`, `max`, `returnKey` and `showRecordId` of MongoDB's `find`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct KeyOptions {
    /// The first key of the hinted index that is read, with a value for each of its fields; empty reads from its start.
    pub min: Document,
    /// The first key that is not read any more; empty reads to the end.
    pub max: Document,
    /// Whether the keys of the index that was read are returned in place of documents.
    pub return_key: bool,
    /// Whether documents are returned with their place in the collection, as `$recordId`.
    pub show_record_id: bool,
}

impl KeyOptions {
    /// Whether nothing is said.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.is_bounded() && !self.return_key && !self.show_record_id
    }

    /// Whether only a part of an index is read.
    #[must_use]
    pub fn is_bounded(&self) -> bool {
        !self.min.is_empty() || !self.max.is_empty()
    }

    /// The options as MongoDB takes them.
    #[must_use]
    pub fn to_document(&self) -> Document {
        let bounds = [("min", &self.min), ("max", &self.max)].into_iter().filter(|(_, bound)| !bound.is_empty());
        let mut options: Document = bounds.map(|(name, bound)| (name.to_owned(), bound.clone().into())).collect();
        let flags = [("returnKey", self.return_key), ("showRecordId", self.show_record_id)];
        options.extend(flags.into_iter().filter(|(_, is_set)| *is_set).map(|(name, _)| (name.to_owned(), true.into())));
        options
    }

    /// Checks that both bounds, where there are two, have the same fields.
    ///
    /// # Errors
    /// If they have not.
    pub fn check(&self) -> Result<(), QueryError> {
        if self.min.is_empty() || self.max.is_empty() || self.min.keys().eq(self.max.keys()) {
            return Ok(());
        }
        Err(QueryError::invalid(DIFFERENT_FIELDS, "min and max must have the same field names, in the same order"))
    }
}

/// Gives what a projection made of a document the place that the document was shown with.
pub(crate) fn keep_record_id(from: &RawDocumentBuf, to: &mut RawDocumentBuf) {
    let position = from.get(RECORD_ID).ok().flatten().and_then(|position| position.as_i64());
    if let (Some(position), Ok(None)) = (position, to.get(RECORD_ID)) {
        to.append(RECORD_ID, position);
    }
}
