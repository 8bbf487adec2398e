//! Why a backend is not as it should be.

use crate::fault::{AtFault, Fault};
use crate::settings::backend::Backend;
use crate::store::StoreError;
use crate::store::mongodb::admin::AdminError;

/// Why a process is not as it should be.
#[derive(Debug, thiserror::Error)]
pub enum BackendError {
    /// mongod is not installed.
    #[error(
        "the backend `{backend}` needs the program `{program}`, which is not there; install MongoDB, or name its path: [backend.{backend}] mongod = \"…\""
    )]
    NoProgram {
        /// Which table of the settings.
        backend: &'static str,
        /// The program.
        program: String,
    },
    /// Anything else.
    #[error("the backend `{backend}` fails")]
    Failed {
        /// Which table of the settings.
        backend: &'static str,
        /// What went wrong.
        source: StoreError,
    },
}

impl AtFault for BackendError {
    fn fault(&self) -> Fault {
        match self {
            Self::NoProgram { .. } => Fault::Program,
            Self::Failed { source, .. } => source.fault(),
        }
    }
}

/// A failure of a process, with what to do about it.
pub(super) fn failed(backend: &Backend, reason: impl Into<String>) -> BackendError {
    let source = StoreError::Failed { address: backend.address(), reason: reason.into() };
    BackendError::Failed { backend: backend.name, source }
}

/// The error for an answer of the process, or for none.
pub(super) fn answered(backend: &Backend, error: AdminError) -> BackendError {
    BackendError::Failed { backend: backend.name, source: error.into() }
}
