//! What whoever raises an error knows about what to do.

/// A hint that an error brings along, as its source.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct Hint(pub(super) String);
