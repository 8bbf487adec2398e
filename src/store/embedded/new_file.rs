//! A new file that appears whole or not at all: it is made under a name of its own in its folder, and renamed at the end.

use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::failure;
use super::place::{Place, companions, folder};
use crate::interrupt::Unfinished;
use crate::process::stale_files;
use crate::store::StoreError;

/// A file that does not have its name yet. Dropped, it is removed, with what is beside it; the next process that makes one in
/// the folder removes what a killed one left.
pub(super) struct NewFile<'a> {
    path: &'a Path,
    place: Place,
    staged: NamedTempFile,
    _unfinished: Unfinished,
    _beside: Beside,
}

/// What SQLite made beside a file, removed when it is dropped.
struct Beside(Vec<PathBuf>);

impl Drop for Beside {
    fn drop(&mut self) {
        self.0.iter().for_each(|file| drop(std::fs::remove_file(file)));
    }
}

impl<'a> NewFile<'a> {
    /// Makes an empty file that is to be called `path`.
    ///
    /// # Errors
    /// Where there is something of that name, or no file can be made there.
    pub(super) fn beside(path: &'a Path) -> Result<Self, StoreError> {
        let place = Place::File(path.to_owned());
        let failed = |reason: String| StoreError::Failed { address: place.to_string(), reason };
        if path.symlink_metadata().is_ok() || path.try_exists().unwrap_or(true) {
            return Err(failed("exists already; name a file that does not exist yet".to_owned()));
        }
        let folder = folder(path);
        if !folder.is_dir() {
            return Err(failed(format!("its folder {} does not exist; create it first", folder.display())));
        }
        // The error would name the temporary file.
        let unnamed = |error: std::io::Error| {
            let reason = failure::io(&error);
            let reason = reason.split(" at path ").next().unwrap_or_default();
            failed(format!("cannot make a file in {}: {reason}", folder.display()))
        };
        let prefix = stale_files::prefix(folder, ".rmem-");
        let make = || tempfile::Builder::new().prefix(&prefix).tempfile_in(folder).map_err(unnamed);
        let own = |staged: &NamedTempFile| {
            let path = staged.path();
            companions(path).into_iter().chain([path.to_owned()]).collect()
        };
        let (staged, unfinished) = Unfinished::making(make, own)?;
        let beside = companions(staged.path()).into();
        Ok(Self { path, place, _unfinished: unfinished, _beside: Beside(beside), staged })
    }

    /// Its name until then.
    pub(super) fn staged(&self) -> &Path {
        self.staged.path()
    }

    /// What it is called at the end.
    pub(super) fn place(&self) -> &Place {
        &self.place
    }

    /// Lets those read it who may read another file.
    pub(super) fn permit_as(&self, other: &Path) -> Result<(), StoreError> {
        use std::os::unix::fs::PermissionsExt as _;
        let permit = || {
            let mode = std::fs::metadata(other)?.permissions().mode() & 0o666 | 0o600;
            std::fs::set_permissions(self.staged.path(), std::fs::Permissions::from_mode(mode))
        };
        permit().map_err(|error| StoreError::Failed { address: self.place.to_string(), reason: failure::io(&error) })
    }

    /// Gives it its name, once it is on the disk.
    pub(super) fn keep(self) -> Result<(), StoreError> {
        let Self { path, place, staged, .. } = self;
        let write =
            |error: std::io::Error| StoreError::Failed { address: place.to_string(), reason: failure::io(&error) };
        std::fs::File::open(staged.path()).and_then(|file| file.sync_all()).map_err(write)?;
        staged.persist_noclobber(path).map_err(|error| write(error.error))?;
        std::fs::File::open(folder(path)).and_then(|folder| folder.sync_all()).map_err(write)
    }
}
