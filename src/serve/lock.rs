//! That one process at a time serves a file, and which.
//!
//! It has a lock on `FILE-serve`, which goes when the process ends however it ends; in the file is how
//! it is reached.

use std::fs::{File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use crate::fault::{AtFault, Fault};

use rustix::fs::{FlockOperation, flock};

/// While it lives, no other process serves the file.
pub struct Lock {
    file: File,
    path: PathBuf,
}

/// The server of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holder {
    /// Its process id.
    pub process: u32,
    /// How it is reached.
    pub uris: String,
}

/// Why a file cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another process serves it.
    #[error("{}: process {} serves this file already, at {}; connect to that, or end it", path.display(), holder.process, holder.uris)]
    Held {
        /// Which file.
        path: PathBuf,
        /// Its process.
        holder: Holder,
    },
    /// It has several names, each of which has a log of its own.
    #[error(
        "{}: the file has {links} names (hard links), and a memory that is written through two of them is damaged; \
         copy it, or remove the others: `find . -samefile {}`", path.display(), path.display()
    )]
    Linked {
        /// Which file.
        path: PathBuf,
        /// How many names it has.
        links: u64,
    },
    /// The lock cannot be written.
    #[error("{}: {source}", path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
}

impl AtFault for LockError {
    fn fault(&self) -> Fault {
        match self {
            Self::Held { .. } | Self::Linked { .. } => Fault::Conflict,
            Self::File { .. } => Fault::Store,
        }
    }
}

impl Lock {
    /// Takes the lock of a memory's file.
    ///
    /// # Errors
    /// Where another process has it, the file has another name, or the lock cannot be written.
    pub fn take(memory: &Path) -> Result<Self, LockError> {
        // SQLite's advice: <https://www.sqlite.org/howtocorrupt.html#_multiple_links_to_the_same_file>.
        let links = memory.metadata().map_or(1, |found| found.nlink());
        if links > 1 {
            return Err(LockError::Linked { path: memory.to_owned(), links });
        }
        let path = beside(memory);
        let failed = |source| LockError::File { path: path.clone(), source };
        let file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).map_err(failed)?;
        if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
            let holder = read(&path).unwrap_or(Holder { process: 0, uris: String::new() });
            return Err(LockError::Held { path: memory.to_owned(), holder });
        }
        Ok(Self { file, path })
    }

    /// Says how this process is reached.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn write_uris(&mut self, uris: &str) -> Result<(), LockError> {
        let failed = |source| LockError::File { path: self.path.clone(), source };
        self.file.set_len(0).map_err(failed)?;
        write!(self.file, "{}\n{uris}\n", std::process::id()).map_err(failed)
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Another process may have opened it by now, and locks what has no name then: the next makes a new one.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// The server of a memory's file, if one runs.
#[must_use]
pub fn holder(memory: &Path) -> Option<Holder> {
    let path = beside(memory);
    let file = File::open(&path).ok()?;
    flock(&file, FlockOperation::NonBlockingLockShared).is_err().then(|| read(&path)).flatten()
}

fn read(path: &Path) -> Option<Holder> {
    let mut text = String::new();
    File::open(path).ok()?.take(64 << 10).read_to_string(&mut text).ok()?;
    let (process, uris) = text.split_once('\n')?;
    Some(Holder { process: process.parse().ok()?, uris: uris.trim().replace('\n', ", ") })
}

/// Beside the file itself, whichever symbolic link leads to it, also where it is not there yet.
fn beside(memory: &Path) -> PathBuf {
    let named = || match memory.read_link() {
        Ok(target) => memory.parent().map_or(target.clone(), |folder| folder.join(&target)),
        Err(_) => memory.to_owned(),
    };
    let mut path = memory.canonicalize().unwrap_or_else(|_| named()).into_os_string();
    path.push("-serve");
    path.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_process_serves_a_file_and_says_where() {
        let folder = tempfile::tempdir().unwrap();
        let memory = folder.path().join("robot.rmem");
        assert_eq!(holder(&memory), None);
        let mut lock = Lock::take(&memory).unwrap();
        lock.write_uris("mongodb://127.0.0.1:1/\nmongodb://%2Ftmp%2Fx/").unwrap();
        let found = holder(&memory).unwrap();
        assert_eq!(found.process, std::process::id());
        assert_eq!(found.uris, "mongodb://127.0.0.1:1/, mongodb://%2Ftmp%2Fx/");
        assert!(matches!(Lock::take(&memory), Err(LockError::Held { holder, .. }) if holder == found));
        drop(lock);
        assert_eq!(holder(&memory), None);
        assert!(Lock::take(&memory).is_ok());
    }

    #[test]
    fn a_file_has_one_lock_whatever_name_leads_to_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name| folder.path().join(name);
        std::os::unix::fs::symlink("robot.rmem", path("link.rmem")).unwrap();
        for is_there in [false, true] {
            if is_there {
                std::fs::write(path("robot.rmem"), "").unwrap();
            }
            let lock = Lock::take(&path("link.rmem")).unwrap();
            assert!(matches!(Lock::take(&path("robot.rmem")), Err(LockError::Held { .. })), "{is_there}");
            drop(lock);
        }
        std::fs::hard_link(path("robot.rmem"), path("hard.rmem")).unwrap();
        assert!(matches!(Lock::take(&path("hard.rmem")), Err(LockError::Linked { links: 2, .. })));
    }
}
