//! Finding a document and changing it in one step: what a queue of work or a counter needs.

use super::operations::{has_hidden, stored};
use super::{Memory, hidden_metadata};
use crate::store::{FindAndModify, Modification, Modified, Namespace, StoreError, metadata};

impl Memory {
    /// Finds the first stored document that matches, changes or removes it, and returns it without metadata, unless the
    /// projection names some. No other client changes it in between. See [`Store::find_and_modify`].
    ///
    /// [`Store::find_and_modify`]: crate::store::Store::find_and_modify
    ///
    /// # Errors
    /// Where the query or the update is wrong, the store fails, or other clients change the document all the time.
    pub fn find_and_modify(&self, ns: &Namespace, request: &FindAndModify) -> Result<Modified, StoreError> {
        let projection = hidden_metadata::in_projection(&request.projection);
        let request = FindAndModify { projection, ..request.clone() };
        let mut modified = self.find_and_modify_with_metadata(ns, &request)?;
        if has_hidden(&request.projection) {
            modified.document = modified.document.map(metadata::hide).transpose()?;
        }
        Ok(modified)
    }

    /// The same with the metadata of the document.
    ///
    /// # Errors
    /// As [`Memory::find_and_modify`].
    pub fn find_and_modify_with_metadata(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
    ) -> Result<Modified, StoreError> {
        let now = self.clock.now();
        let mut request = FindAndModify { filter: stored(now, &request.filter), ..request.clone() };
        if let Modification::Update { update, .. } = &mut request.modification {
            *update = hidden_metadata::in_update(update);
        }
        self.check_kept_modification(ns, &request)?;
        let upserts = matches!(request.modification, Modification::Update { upsert: true, .. });
        let work = || {
            let store = self.routes.writing(ns, upserts)?;
            store.find_and_modify(ns, &request, Some(now))
        };
        self.journal.note("find-and-modify", Some(ns), |modified| u64::from(modified.is_changed), work)
    }
}
