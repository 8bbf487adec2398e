//! Which stored document has a unique key that another was to have.

use bson::{Bson, doc};

use crate::formats::shell;
use crate::memory::Memory;
use crate::query::{Collation, field};
use crate::store::{Find, Modifiers, StoreError};

/// Returns the `_id` of the document that has the key; none where the key is the `_id` itself, or the document is not
/// found for certain.
pub(super) fn holder(error: &StoreError, memory: &Memory) -> Option<Bson> {
    let (namespace, key) = match error {
        StoreError::Duplicate { namespace, key, .. } => (namespace, key),
        StoreError::Stopped { source, .. } | StoreError::Partial { source, .. } => return holder(source, memory),
        _ => return None,
    };
    let name = key.index().filter(|_| !key.values().is_empty())?;
    let indexes = memory.indexes(namespace).unwrap_or_default();
    let index = indexes.iter().find(|known| known.name == name);
    let option = |option: &str| index.and_then(|index| index.other.get_document(option).ok());
    let collation = option("collation").map(Collation::parse).transpose().ok()?;
    let partial = option("partialFilterExpression").cloned().unwrap_or_default();
    let find = Find {
        filter: doc! { "$and": [key.values(), partial] },
        projection: doc! { "_id": 1 },
        limit: 2,
        modifiers: Modifiers { collation, ..Modifiers::default() },
        ..Find::default()
    };
    let mut found = memory.find(namespace, &find).ok()?;
    // Of several, it is not known which.
    let (Some(Ok(holder)), None) = (found.next(), found.next()) else { return None };
    Bson::try_from(field(&holder, "_id")?).ok()
}

/// The document as messages name it behind what it has.
pub(super) fn named(id: &Bson) -> String {
    format!(": that with _id {}", shell::relaxed_value(id))
}
