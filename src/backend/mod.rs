//! The mongod processes of a robot: started, made members of their replica sets, looked at, stopped.
//!
//! A robot has up to two, one for what is private to it and one that replicates
//! what the robots share ([`crate::settings::backend::Backend`]). Each is a member of a
//! replica set, the private one of a set of its own, because only those tell of changes.
//!
//! A process runs on its own once it is started; nothing remembers it but the
//! system. So whether a process is ours is asked of the process itself each
//! time, by where its data and its log are. A robot founds a set only where
//! a majority of all its members answers and none belongs to it yet, and always
//! through the first of them: two robots that found one at once found the same.

mod process;
mod set;
mod status;

pub use process::{Down, Running, down};
pub use set::{Settled, settle};
pub use status::{Row, status};

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

/// Starts a process that does not run; says what runs now.
///
/// # Errors
/// Where mongod is missing or does not start, or its port is taken by something else.
pub fn up(backend: &Backend) -> Result<Running, BackendError> {
    process::up(backend)
}

/// A failure of a process, with what to do about it.
fn failed(backend: &Backend, reason: impl Into<String>) -> BackendError {
    let source = StoreError::Failed { address: backend.address(), reason: reason.into() };
    BackendError::Failed { backend: backend.name, source }
}

/// What the process itself said, or that it said nothing.
fn said(backend: &Backend, error: AdminError) -> BackendError {
    BackendError::Failed { backend: backend.name, source: error.into() }
}
