//! Whether the files that are served still have their names.
//!
//! A file that is moved or removed while it is open is written to all the same, and whoever opens its name next finds
//! another one, or none. So each write looks at the name before it is acknowledged, and at that of its write-ahead log, which
//! is not read either once it is removed.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::fault::{AtFault, Fault};
use crate::process::stale_files::SQLITE_LOG;
use crate::store::FileIdentity;

/// A file that is served, or its log, does not have its name any more.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Moved {
    /// The file.
    #[error("{}: the file was moved or removed while it was served, or another took its name; \
             nothing more is written, and what was acknowledged is in the file that was moved", .0.display())]
    File(PathBuf),
    /// Its log.
    #[error("{}: this log was moved or removed while its file was served, or another took its name; nothing more is \
             written; what was acknowledged is brought from the log into the file, as far as that can be done: look at it \
             with `rmem doctor --deep`", .0.display())]
    Log(PathBuf),
}

impl AtFault for Moved {
    fn fault(&self) -> Fault {
        Fault::Store
    }
}

/// The files that are served.
#[derive(Debug, Default)]
pub(super) struct Files(Mutex<Vec<Served>>);

/// A file that is served.
#[derive(Debug)]
struct Served {
    path: PathBuf,
    /// None as long as there is no file.
    identity: Option<FileIdentity>,
    log: PathBuf,
    /// The log as it was last seen; none where there was none.
    log_identity: Option<FileIdentity>,
    moved: Option<Moved>,
}

impl Served {
    /// Looks at the names. A file that has moved once does not come back: others may have written to it since.
    fn check(&mut self) -> Result<(), Moved> {
        if self.moved.is_none() {
            self.moved = if self.has_moved() {
                Some(Moved::File(self.path.clone()))
            } else {
                self.has_lost_log().then(|| Moved::Log(self.log.clone()))
            };
        }
        self.moved.clone().map_or(Ok(()), Err)
    }

    fn has_moved(&mut self) -> bool {
        match named(&self.path) {
            Ok(Some(found)) => *self.identity.get_or_insert(found) != found,
            Ok(None) => self.identity.is_some(),
            // A file system that does not answer says nothing about the file.
            Err(_) => false,
        }
    }

    /// The log is removed when the last process closes the file, and made again with the next one. While this process writes to it,
    /// it has its name.
    fn has_lost_log(&mut self) -> bool {
        let Ok(found) = named(&self.log) else { return false };
        if found == self.log_identity {
            return false;
        }
        let is_lost = self.log_identity.is_some_and(is_open);
        if !is_lost {
            self.log_identity = found;
        }
        is_lost
    }
}

/// The log of a file, which is beside that, wherever a link to it is.
fn log_of(path: &Path) -> PathBuf {
    let mut name = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned()).into_os_string();
    name.push(SQLITE_LOG);
    name.into()
}

/// The file that a path names at the moment, if there is one.
fn named(path: &Path) -> std::io::Result<Option<FileIdentity>> {
    match FileIdentity::at(path) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        found => found.map(Some),
    }
}

/// Whether this process has a file open.
fn is_open(identity: FileIdentity) -> bool {
    let Ok(open) = fs::read_dir("/dev/fd") else { return false };
    open.flatten().any(|file| FileIdentity::at(&file.path()).is_ok_and(|open| open == identity))
}

impl Files {
    /// Adds a file.
    pub(super) fn add(&self, path: &Path) {
        let path = path.to_owned();
        let mut served = Served { log: log_of(&path), path, identity: None, log_identity: None, moved: None };
        // Nothing was seen before that could be missed.
        let _ = served.check();
        self.lock().push(served);
    }

    /// Looks whether all files are there still.
    ///
    /// # Errors
    /// Where one is not.
    pub(super) fn check(&self) -> Result<(), Moved> {
        self.lock().iter_mut().try_for_each(Served::check)
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Served>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_that_was_moved_is_missed_though_another_takes_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("a"), folder.path().join("b"));
        let files = Files::default();
        files.add(&path);
        assert_eq!(files.check(), Ok(()));
        fs::write(&path, "").unwrap();
        assert_eq!(files.check(), Ok(()));
        fs::rename(&path, &other).unwrap();
        fs::write(&path, "").unwrap();
        assert_eq!(files.check(), Err(Moved::File(path.clone())));
        fs::rename(&other, &path).unwrap();
        assert_eq!(files.check(), Err(Moved::File(path)));
    }

    #[test]
    fn a_log_is_missed_while_it_is_written_to() {
        let folder = tempfile::tempdir().unwrap();
        let (path, log) = (folder.path().join("a"), folder.path().join("a-wal"));
        let files = Files::default();
        files.add(&path);
        for _ in 0..2 {
            fs::write(&log, "").unwrap();
            assert_eq!(files.check(), Ok(()));
            fs::remove_file(&log).unwrap();
            assert_eq!(files.check(), Ok(()));
        }
        let written = fs::File::create(&log).unwrap();
        assert_eq!(files.check(), Ok(()));
        fs::remove_file(&log).unwrap();
        assert_eq!(files.check(), Err(Moved::Log(log.clone())));
        drop(written);
        assert_eq!(files.check(), Err(Moved::Log(log)));
    }
}
