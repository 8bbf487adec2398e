//! How a run ends.

use std::io;

use super::host::Host;

/// How a program ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum End {
    Exited(i32),
    Signalled(i32),
    OutOfTime,
    TooMuchOutput,
    Interrupted,
    /// Its processes together had more memory than they may.
    Starved,
    /// There is no such program.
    Missing,
    /// It is a script for an interpreter that is not there.
    NoInterpreter(String),
    /// The files of the run could not be made: a fault of this machine, not of the program.
    NoFiles(String),
    /// Its supervisor ended before it.
    SupervisorGone(String),
    /// It could not be run at all.
    Failed(String),
}

impl End {
    /// Why it could not be run to an end of its own, where that is so.
    pub(super) fn failure(&self) -> Option<&str> {
        match self {
            Self::NoFiles(words) | Self::SupervisorGone(words) | Self::Failed(words) => Some(words),
            _ => None,
        }
    }

    /// Returns that the files of a run cannot be made.
    pub(super) fn no_files(host: &Host<'_>, error: &io::Error) -> Self {
        // The name of the file is rmem's own.
        let reason = io::Error::from(error.kind());
        let advice = if error.kind() == io::ErrorKind::NotFound { "create the folder" } else { "free space there" };
        let folder = host.temporary.display();
        Self::NoFiles(format!("no files can be made for a run in {folder}: {reason}; {advice}, or set TMPDIR"))
    }
}

impl From<io::Error> for End {
    fn from(error: io::Error) -> Self {
        Self::Failed(error.to_string())
    }
}
