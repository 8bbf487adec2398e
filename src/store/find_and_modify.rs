//! Finding a document and changing it in one step: what a queue of work or a counter needs.

use bson::{Bson, Document, RawDocumentBuf};

use super::modifiers::Modifiers;
use super::request::{Find, UpdateRequest, UpdateSpec};
use crate::query::{QueryError, check_positional, check_upsert, is_positional};

/// What happens to the document that is found.
#[derive(Debug, Clone)]
pub enum Modification {
    /// It is removed.
    Remove,
    /// It is changed.
    Update {
        /// How.
        update: UpdateSpec,
        /// For `$[identifier]`.
        array_filters: Vec<Document>,
        /// Insert what filter and update describe where nothing matches.
        upsert: bool,
    },
}

/// Which document to find, what to do to it, and what of it to return.
#[derive(Debug, Clone)]
pub struct FindAndModify {
    /// MongoDB's filter; empty matches everything.
    pub filter: Document,
    /// Keys with 1 (ascending) or -1 (descending), which decide what the first match is.
    pub sort: Document,
    /// What happens to it.
    pub modification: Modification,
    /// Return the document as it is afterwards, not as it was.
    pub new: bool,
    /// MongoDB's projection of what is returned; empty keeps the document whole.
    pub projection: Document,
    /// Collation, variables, and the index to be read.
    pub modifiers: Modifiers,
}

/// What was done to the first match.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Modified {
    /// The document as it is asked for. None where none matched, or none was there before or is there afterwards.
    pub document: Option<RawDocumentBuf>,
    /// Whether a document matched.
    pub is_found: bool,
    /// Whether a document is different now, removed or inserted.
    pub is_changed: bool,
    /// The `_id` of the document that an upsert made.
    pub upserted: Option<Bson>,
}

impl FindAndModify {
    /// The update alone, of the documents that match another filter; none where documents are removed.
    pub(crate) fn update_of(&self, filter: Document) -> Option<UpdateRequest> {
        let Modification::Update { update, array_filters, upsert } = &self.modification else { return None };
        Some(UpdateRequest {
            filter,
            update: update.clone(),
            array_filters: array_filters.clone(),
            many: false,
            upsert: *upsert,
            modifiers: self.modifiers.without_hint(),
        })
    }

    /// Refuses what does not go together.
    pub(super) fn check(&self) -> Result<(), QueryError> {
        check_positional(&self.filter, &self.projection)?;
        let Modification::Update { upsert, .. } = self.modification else { return Ok(()) };
        if self.new && is_positional(&self.projection) {
            let message = "the positional `$` of a projection is of the document as it was, not of the new one";
            return Err(QueryError::bad_value(message));
        }
        if upsert { check_upsert(&self.filter) } else { Ok(()) }
    }

    /// The query for the first match.
    pub(super) fn find(&self, projection: Document) -> Find {
        let (filter, sort, modifiers) = (self.filter.clone(), self.sort.clone(), self.modifiers.clone());
        Find { filter, sort, limit: 1, projection, modifiers, current: true, ..Find::default() }
    }
}
