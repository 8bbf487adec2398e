//! Which stored document has a unique key that another was to have.

use bson::doc;

use crate::formats::{Source, shell};
use crate::memory::Memory;
use crate::query::field;
use crate::store::{Find, StoreError};

/// Returns the `_id` of the document that has the key, as text; none where the key is the `_id` itself, or the
/// document is not found for certain.
pub(super) fn holder(error: &StoreError, memory: &Memory) -> Option<String> {
    let (namespace, key) = match error {
        StoreError::Duplicate { namespace, key, .. } => (namespace, key),
        StoreError::Stopped { source, .. } => return holder(source, memory),
        _ => return None,
    };
    let (values, index) = key.rsplit_once(" (unique index ")?;
    let values = shell::parse_document(&Source::new("<key>", format!("{{{values}}}"))).ok()?;
    let indexes = memory.indexes(namespace).unwrap_or_default();
    let index = indexes.iter().find(|known| Some(known.name.as_str()) == index.strip_suffix(')'));
    if index.is_some_and(|index| index.other.contains_key("collation")) {
        return None;
    }
    let partial = index.and_then(|index| index.other.get_document("partialFilterExpression").ok()).cloned();
    let filter = doc! { "$and": [values, partial.unwrap_or_default()] };
    let find = Find { filter, projection: doc! { "_id": 1 }, limit: 2, ..Find::default() };
    let mut found = memory.find(namespace, &find).ok()?;
    // Of several, it is not known which.
    let (Some(Ok(holder)), None) = (found.next(), found.next()) else { return None };
    let id = field(&holder, "_id")?;
    bson::Bson::try_from(id).ok().map(|id| shell::relaxed_value(&id))
}
