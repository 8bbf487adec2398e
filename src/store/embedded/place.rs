//! Where an embedded store lives.

use std::fmt;
use std::path::PathBuf;

/// Where an embedded store lives; its `Display` is what messages call it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Place {
    File(PathBuf),
    Memory,
}

impl Place {
    /// The path of the write-ahead log.
    pub(super) fn log(&self) -> Option<PathBuf> {
        let Self::File(path) = self else { return None };
        let mut log = path.clone().into_os_string();
        log.push("-wal");
        Some(log.into())
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => write!(f, "file:{}", path.display()),
            Self::Memory => f.write_str("mem:"),
        }
    }
}
