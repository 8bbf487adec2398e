//! Stored documents of a collection, and the errors for those that are damaged.

use super::catalog::Collection;
use super::damage::Damage;
use super::{Embedded, body};
use crate::store::StoreError;

impl Embedded {
    /// The error for a damaged document of a collection; `name` is its `_id`, as far as it is known.
    pub(super) fn damaged(&self, collection: Collection, name: Option<&str>, damage: Damage) -> StoreError {
        let ns = self.name(collection);
        let document = name.map_or_else(|| "a document".to_owned(), |id| format!("the document with _id {id}"));
        self.fail(&format!(
            "{document} of {ns} is damaged: {}; list all damage with `rmem doctor --deep`, and copy what can be read \
             into a new file with `rmem repair -o FILE`",
            damage.describe()
        ))
    }

    /// What errors call a collection.
    pub(super) fn name(&self, collection: Collection) -> String {
        let ns = collection.namespace(&self.connection).ok().flatten();
        ns.map_or_else(|| "a collection".to_owned(), |ns| ns.to_string())
    }

    /// The document in stored bytes, as a value.
    pub(super) fn opened(&self, collection: Collection, stored: &[u8]) -> Result<bson::RawDocumentBuf, StoreError> {
        body::open(stored)
            .map(ToOwned::to_owned)
            .map_err(|damage| self.damaged(collection, body::name(stored).as_deref(), damage))
    }
}
