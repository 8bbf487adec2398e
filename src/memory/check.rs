//! Checking and copying whole stores.

use std::path::Path;

use super::Memory;
use crate::store::{Checked, StoreError};

impl Memory {
    /// Checks everything in the local store, and in the shared one where it is another; `report` gets
    /// each damage, as a sentence. Returns the address of each store, with what was checked, or `None`
    /// where the store has no such check.
    ///
    /// # Errors
    /// Where a store cannot be opened, or its list of collections cannot be read.
    pub fn check(&self, mut report: impl FnMut(&str)) -> Result<Vec<(String, Option<Checked>)>, StoreError> {
        let check = |store: &dyn crate::store::Store| Ok((store.describe(), store.check(&mut report)?));
        self.routes.stores()?.into_iter().map(check).collect()
    }

    /// Copies the local store into a new file; see [`crate::store::Store::backup`].
    ///
    /// # Errors
    /// Where the store is not a file, or the new one exists or cannot be written.
    pub fn backup(&self, path: &Path) -> Result<(), StoreError> {
        self.routes.local()?.backup(path)
    }
}
