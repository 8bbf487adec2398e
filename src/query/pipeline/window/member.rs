//! The documents of a partition.

use bson::{Bson, RawDocumentBuf};

use super::order::Order;
use crate::query::error::QueryError;
use crate::query::number::Number;

/// A document of a partition.
pub(super) struct Member {
    pub(super) document: RawDocumentBuf,
    /// Its place in the order of the partition.
    pub(super) place: Vec<u8>,
    /// The value of the only field that is sorted by.
    pub(super) at: Option<Bson>,
}

impl Member {
    pub(super) fn new(document: RawDocumentBuf, place: Vec<u8>, order: &Order) -> Self {
        Self { at: order.value((&*document).into()), document, place }
    }
}

/// Returns the error for a wrong window.
pub(super) fn wrong(message: impl Into<String>) -> QueryError {
    QueryError::failed_to_parse(message)
}

/// Returns the number that a value is, if it is one.
pub(super) fn number(value: Option<&Bson>) -> Option<Number> {
    value.and_then(Number::of)
}
