//! What was looked at to answer a query.

use std::cell::Cell;

/// What was looked at to answer a query.
#[derive(Debug, Default)]
pub(in crate::store::embedded) struct Examined {
    /// Keys of indexes.
    pub(in crate::store::embedded) keys: Cell<u64>,
    /// Documents.
    pub(in crate::store::embedded) documents: Cell<u64>,
}

impl Examined {
    pub(super) fn add(counter: &Cell<u64>, more: u64) {
        counter.set(counter.get() + more);
    }
}
