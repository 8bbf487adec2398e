//! Whether the files that are served still have their names.
//!
//! A file that is moved or removed while it is open is written to all the same, and whoever opens its name next finds
//! another one, or none. So each write looks at the name before it is acknowledged.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::fault::{AtFault, Fault};
use crate::store::FileIdentity;

/// A file that is served does not have its name any more.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: the file was moved or removed while it was served, or another took its name; \
         nothing more is written, and what was acknowledged is in the file that was moved", path.display())]
pub struct Moved {
    path: PathBuf,
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
    has_moved: bool,
}

impl Served {
    /// Looks at the name. A file that has moved once does not come back: others may have written to it since.
    fn has_moved(&mut self) -> bool {
        match FileIdentity::at(&self.path) {
            Ok(found) => self.has_moved |= *self.identity.get_or_insert(found) != found,
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                self.has_moved |= self.identity.is_some();
            }
            // A file system that does not answer says nothing about the file.
            Err(_) => {}
        }
        self.has_moved
    }
}

impl Files {
    /// Adds a file.
    pub(super) fn add(&self, path: &Path) {
        let mut served = Served { path: path.to_owned(), identity: None, has_moved: false };
        served.has_moved();
        self.lock().push(served);
    }

    /// Looks whether all files are there still.
    ///
    /// # Errors
    /// Where one is not.
    pub(super) fn check(&self) -> Result<(), Moved> {
        let mut files = self.lock();
        match files.iter_mut().find_map(|file| file.has_moved().then(|| file.path.clone())) {
            Some(path) => Err(Moved { path }),
            None => Ok(()),
        }
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
        assert_eq!(files.check(), Err(Moved { path: path.clone() }));
        fs::rename(&other, &path).unwrap();
        assert_eq!(files.check(), Err(Moved { path }));
    }
}
