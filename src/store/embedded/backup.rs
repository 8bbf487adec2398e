//! A copy of the file, while other processes read and write: `rmem backup FILE`.

use std::path::Path;

use rusqlite::Connection;

use super::new_file::NewFile;
use super::{Embedded, failure};
use crate::store::StoreError;

impl Embedded {
    /// Copies the memory, as it is at one moment, into a new file. The file appears whole or not at all.
    pub(super) fn copy_to(&self, path: &Path) -> Result<(), StoreError> {
        let copy = NewFile::beside(path)?;
        let Some(name) = copy.staged().to_str() else {
            let reason = "its path is not UTF-8".to_owned();
            return Err(StoreError::Failed { address: copy.place().to_string(), reason });
        };
        self.connection
            .execute("VACUUM INTO ?", [name])
            .and_then(|_| Connection::open(name)?.pragma_update(None, "journal_mode", "WAL"))
            .map_err(|error| match failure::is_damage(&error) {
                true => self.explain(&error),
                false => failure::explain_copy(copy.place(), &error),
            })?;
        copy.keep()
    }
}
