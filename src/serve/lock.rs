//! That one process at a time serves a file, and which.
//!
//! It has a lock on `FILE-serve`, which goes when the process ends however it ends; in the file is how
//! it is reached.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

use crate::fault::{AtFault, Fault};
use crate::store::FileIdentity;

/// How often a lock is tried that another process has: [`holder`] has it for a moment.
const ATTEMPTS: u32 = 20;
/// The time between two attempts: [`holder`] has the lock for less.
const RETRY_DELAY: Duration = Duration::from_millis(5);

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
    #[error("{}: {} serves this file already{}; connect to that, or end it", path.display(), name(holder.as_ref()), place(holder.as_ref()))]
    Held {
        /// Which file.
        path: PathBuf,
        /// Its process, once that has said how it is reached.
        holder: Option<Holder>,
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
        for _ in 0..ATTEMPTS {
            let file =
                OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).map_err(failed)?;
            if !try_lock(&file, FlockOperation::NonBlockingLockExclusive).map_err(failed)? {
                std::thread::sleep(RETRY_DELAY);
            } else if is_at(&file, &path) {
                // Here may be how a server is reached that was killed.
                file.set_len(0).map_err(failed)?;
                return Ok(Self { file, path });
            }
        }
        Err(LockError::Held { path: memory.to_owned(), holder: read(&path) })
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
        // Another process that has opened it by now finds that it has no name, and makes a new one.
        if is_at(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// The server of a memory's file, if one runs.
#[must_use]
pub fn holder(memory: &Path) -> Option<Holder> {
    let path = beside(memory);
    let file = File::open(&path).ok()?;
    let is_free = try_lock(&file, FlockOperation::NonBlockingLockShared).unwrap_or(true);
    if is_free { None } else { read(&path) }
}

/// Takes a lock; says whether no other process has it.
fn try_lock(file: &File, operation: FlockOperation) -> io::Result<bool> {
    match flock(file, operation) {
        Ok(()) => Ok(true),
        Err(Errno::WOULDBLOCK) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// Whether an open file is the one at a path, and not one that was removed from there.
fn is_at(file: &File, path: &Path) -> bool {
    let Ok(open) = file.metadata() else { return false };
    FileIdentity::at(path).is_ok_and(|named| named == FileIdentity::of(&open))
}

fn name(holder: Option<&Holder>) -> String {
    holder.map_or("another process".to_owned(), |holder| format!("process {}", holder.process))
}

fn place(holder: Option<&Holder>) -> String {
    holder.map_or(String::new(), |holder| format!(", at {}", holder.uris))
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
        assert!(matches!(Lock::take(&memory), Err(LockError::Held { holder, .. }) if holder.as_ref() == Some(&found)));
        drop(lock);
        assert_eq!(holder(&memory), None);
        assert!(Lock::take(&memory).is_ok());
    }

    #[test]
    fn a_lock_file_that_was_removed_while_it_was_waited_for_lets_no_second_server_in() {
        let folder = tempfile::tempdir().unwrap();
        let memory = folder.path().join("robot.rmem");
        for round in 0..200 {
            let first = Lock::take(&memory).unwrap();
            let other = memory.clone();
            let second = std::thread::spawn(move || Lock::take(&other));
            drop(first);
            let second = second.join().unwrap().unwrap();
            assert!(is_at(&second.file, &second.path), "round {round}");
        }
    }

    #[test]
    fn the_end_of_a_server_leaves_the_lock_of_another() {
        let folder = tempfile::tempdir().unwrap();
        let memory = folder.path().join("robot.rmem");
        let first = Lock::take(&memory).unwrap();
        fs::remove_file(beside(&memory)).unwrap();
        let second = Lock::take(&memory).unwrap();
        drop(first);
        assert!(is_at(&second.file, &second.path));
        assert!(matches!(Lock::take(&memory), Err(LockError::Held { holder: None, .. })));
    }

    #[test]
    fn a_look_at_who_serves_a_file_does_not_keep_a_server_from_it() {
        let folder = tempfile::tempdir().unwrap();
        let memory = folder.path().join("robot.rmem");
        fs::write(beside(&memory), "1\nmongodb://127.0.0.1:1/\n").unwrap();
        let probe = File::open(beside(&memory)).unwrap();
        assert!(try_lock(&probe, FlockOperation::NonBlockingLockShared).unwrap());
        let other = memory.clone();
        let server = std::thread::spawn(move || Lock::take(&other).map(drop));
        std::thread::sleep(RETRY_DELAY * 2);
        drop(probe);
        server.join().unwrap().unwrap();
    }
}
