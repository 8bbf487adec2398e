//! Where an embedded store lives.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::process::stale_files;
use crate::store::FileIdentity;

/// Where an embedded store lives; its `Display` is what messages call it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Place {
    File(PathBuf),
    Memory,
}

impl Place {
    /// The folder of the file.
    pub(super) fn folder(&self) -> Option<&Path> {
        let Self::File(path) = self else { return None };
        Some(folder(path))
    }

    /// The path of the file.
    pub(super) fn file(&self) -> Option<PathBuf> {
        let Self::File(path) = self else { return None };
        Some(path.clone())
    }

    /// Which file is at the path at the moment.
    pub(super) fn identity(&self) -> Option<FileIdentity> {
        let Self::File(path) = self else { return None };
        FileIdentity::at(path).ok()
    }

    /// The path of the write-ahead log.
    pub(super) fn log(&self) -> Option<PathBuf> {
        let Self::File(path) = self else { return None };
        Some(log(path))
    }
}

/// The write-ahead log of a file.
pub(super) fn log(path: &Path) -> PathBuf {
    with_end(path, stale_files::SQLITE_LOG)
}

/// The files that SQLite makes beside a file.
pub(super) fn companions(path: &Path) -> [PathBuf; 3] {
    stale_files::SQLITE_ENDS.map(|end| with_end(path, end))
}

fn with_end(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    name.into()
}

/// The folder of a file.
pub(super) fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => write!(f, "file:{}", path.display()),
            Self::Memory => f.write_str("mem:"),
        }
    }
}
