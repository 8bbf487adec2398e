//! The outcome of an action, and what it means for the document as a whole.

use std::cell::Cell;

use bson::{Bson, DateTime};

/// MongoDB's code PathNotViable: a path leads through a value that is not a document.
pub(super) const PATH_NOT_VIABLE: i32 = 28;

/// What an action does to the value at its path.
pub(super) enum Outcome {
    /// Leaves it unchanged.
    Keep,
    /// Replaces it by this value.
    Put(Bson),
    /// Removes it; in an array, null takes its place.
    Remove,
}

/// Time and effects of one update of one document.
pub(super) struct Effects {
    pub(super) now: DateTime,
    /// Whether the update counts as a modification even if no byte changes.
    pub(super) touched: Cell<bool>,
}

impl Effects {
    pub(super) fn new(now: DateTime) -> Self {
        Self { now, touched: Cell::new(false) }
    }
}

/// Returns a time as a BSON timestamp.
pub(super) fn timestamp(now: DateTime) -> Bson {
    let time = u32::try_from(now.timestamp_millis() / 1000).unwrap_or(0);
    Bson::Timestamp(bson::Timestamp { time, increment: 1 })
}
