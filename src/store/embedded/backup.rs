//! A copy of the file, while other processes read and write: `rmem backup FILE`.

use std::path::Path;

use rusqlite::Connection;

use super::place::Place;
use super::{Embedded, failure};
use crate::interrupt::Unfinished;
use crate::process::stale_files;
use crate::store::StoreError;

impl Embedded {
    /// Copies the memory, as it is at one moment, into a new file. The file appears whole or not at all.
    pub(super) fn copy_to(&self, path: &Path) -> Result<(), StoreError> {
        let place = Place::File(path.to_owned());
        let failed = |reason: String| StoreError::Failed { address: place.to_string(), reason };
        if path.try_exists().unwrap_or(true) {
            return Err(failed("exists already; name a file that does not exist yet".to_owned()));
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(failed(format!("its folder {} does not exist; create it first", folder.display())));
        }
        let write = |error: std::io::Error| failed(failure::io(&error));
        // The error would name the temporary file.
        let unnamed = |error: std::io::Error| {
            let reason = failure::io(&error);
            let reason = reason.split(" at path ").next().unwrap_or_default();
            failed(format!("cannot make a file in {}: {reason}", folder.display()))
        };
        let staged = tempfile::Builder::new()
            .prefix(&stale_files::prefix(folder, ".rmem-"))
            .tempfile_in(folder)
            .map_err(unnamed)?;
        let Some(name) = staged.path().to_str() else { return Err(failed("its path is not UTF-8".to_owned())) };
        // What SQLite makes beside the copy goes with it.
        let files = ["", "-journal", "-wal", "-shm"].map(|end| format!("{name}{end}"));
        let _unfinished = files.map(|file| Unfinished::new(Path::new(&file)));
        self.connection
            .execute("VACUUM INTO ?", [name])
            .and_then(|_| Connection::open(name)?.pragma_update(None, "journal_mode", "WAL"))
            .map_err(|error| match failure::is_damage(&error) {
                true => self.explain(&error),
                false => failure::explain_copy(&place, &error),
            })?;
        std::fs::File::open(name).and_then(|file| file.sync_all()).map_err(write)?;
        staged.persist_noclobber(path).map_err(|error| write(error.error))?;
        std::fs::File::open(folder).and_then(|folder| folder.sync_all()).map_err(write)
    }
}
