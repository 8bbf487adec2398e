//! Why a dump cannot be read.

use std::path::PathBuf;

use crate::fault::{AtFault, Fault};
use crate::formats::Diagnostic;
use crate::formats::mongodump::Damage;
use crate::memory::dump::world_file::WorldError;

/// Why a dump cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// A file or folder cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file is truncated or damaged, or a document in it cannot be stored.
    #[error("{}: {damage}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where, and what is wrong.
        damage: Damage,
    },
    /// A file is not what it should be.
    #[error(transparent)]
    Text(#[from] WorldError),
    /// The metadata of a collection is no JSON document.
    #[error("the metadata of {collection} cannot be read")]
    Metadata {
        /// The collection, or its file.
        collection: String,
        /// Where, and what is wrong.
        source: Diagnostic,
    },
    /// A file's name does not give a namespace, or there is nothing to be read.
    #[error("{}: {reason}", path.display())]
    Name {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
}

impl AtFault for ReadError {
    fn fault(&self) -> Fault {
        match self {
            Self::Read { .. } | Self::Damaged { .. } | Self::Metadata { .. } | Self::Name { .. } => Fault::Input,
            Self::Text(error) => error.fault(),
        }
    }
}
