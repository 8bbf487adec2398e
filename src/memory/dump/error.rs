//! Why a dump was not restored.

use super::read::ReadError;
use crate::fault::{AtFault, Fault};
use crate::store::{Namespace, StoreError};

/// Why a dump was not restored.
#[derive(Debug, thiserror::Error)]
pub enum RestoreError {
    /// The dump cannot be read.
    #[error(transparent)]
    Dump(#[from] ReadError),
    /// It was interrupted; with what of the dump is in the memory now.
    #[error("interrupted; {0}")]
    Interrupted(String),
    /// The store fails.
    #[error("cannot restore {which}")]
    Store {
        /// Which namespace, and what of the dump is in the memory now.
        which: String,
        /// What went wrong.
        source: StoreError,
    },
}

impl AtFault for RestoreError {
    fn fault(&self) -> Fault {
        match self {
            Self::Dump(error) => error.fault(),
            Self::Interrupted(_) => Fault::Interrupt,
            Self::Store { source, .. } => source.fault(),
        }
    }
}

/// The error of a restore that was interrupted before it changed anything.
pub(super) fn nothing_done() -> RestoreError {
    RestoreError::Interrupted("nothing was changed".to_owned())
}

/// The error of a store in a restore that changed nothing.
pub(super) fn unchanged(ns: &Namespace, source: StoreError) -> RestoreError {
    RestoreError::Store { which: format!("{ns}; nothing was changed"), source: source.renamed(ns) }
}
