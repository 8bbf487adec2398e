//! What computes.

use std::time::Duration;

use bson::Document;

use crate::memory::Memory;
use crate::store::{Namespace, StoreError};

/// The question that a body answers.
pub(super) struct Asked<'a> {
    /// The memory, for what the answer depends on. What is asked of it may need
    /// other computables, which run then.
    pub(super) memory: &'a Memory,
    /// Where was asked.
    pub(super) namespace: &'a Namespace,
    /// The asked query.
    pub(super) query: &'a Document,
}

/// What computes documents. The query is answered over all documents
/// afterwards: to give more than it asks for is wasteful, but not wrong, and
/// what does not match the query is not seen by it.
pub(super) trait Body {
    /// The documents. One without an `_id` gets one.
    ///
    /// # Errors
    /// Where there are none to be had; nothing is stored then.
    fn compute(&self, asked: &Asked<'_>) -> Result<Vec<Document>, ComputeError>;

    /// What it is, in a line.
    fn describe(&self) -> String;

    /// How long it may take, where it is bound. Another process that asks the
    /// same waits for it so long.
    fn timeout(&self) -> Option<Duration> {
        None
    }
}

/// Why a body gave no documents.
#[derive(Debug, thiserror::Error)]
pub(super) enum ComputeError {
    /// The memory that it asked failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Anything else, in a sentence.
    #[error("{0}")]
    Failed(String),
}
