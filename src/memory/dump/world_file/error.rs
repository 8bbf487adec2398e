//! Why a world file was not loaded.

use crate::fault::{AtFault, Fault};
use crate::formats::Diagnostic;
use crate::formats::shell::ReadError;
use crate::store::StoreError;

/// Why a world file was not loaded.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// It is not a world file.
    #[error("{name} is not a world file")]
    Text {
        /// The file.
        name: String,
        /// Where, and what is wrong.
        source: Diagnostic,
    },
    /// It cannot be read.
    #[error("cannot read {name}: {reason}")]
    Read {
        /// The file.
        name: String,
        /// The system's error.
        reason: String,
    },
    /// A namespace could not be stored; those before it were.
    #[error("cannot put the documents of {namespace} into the memory")]
    Store {
        /// The namespace.
        namespace: String,
        /// What went wrong.
        source: StoreError,
    },
}

impl WorldError {
    /// The error with what to do about a text that is something else.
    pub(in crate::memory::dump) fn hinted(self, hint: Option<String>) -> Self {
        match self {
            Self::Text { name, source } => Self::Text { name, source: hint.into_iter().fold(source, Diagnostic::hint) },
            other => other,
        }
    }
}

impl AtFault for WorldError {
    fn fault(&self) -> Fault {
        match self {
            Self::Text { .. } | Self::Read { .. } => Fault::Input,
            Self::Store { source, .. } => source.fault(),
        }
    }
}

impl From<ReadError> for WorldError {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Text(wrong) => Self::Text { name: wrong.name().to_owned(), source: wrong },
            ReadError::Io { name, error } => Self::Read { name, reason: error.to_string() },
        }
    }
}
