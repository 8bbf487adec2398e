//! Filters for documents with known `_id`s.

use bson::{Bson, Document, doc};

use crate::query::Collation;

/// The filter for the document with an `_id`.
pub(super) fn same(id: &Bson) -> Document {
    doc! { "_id": { "$eq": id } }
}

/// The same for a request with a collation, in which texts that differ may be equal: by the length and the bytes, which the
/// server compares without it.
pub(super) fn exactly(id: &Bson, collation: Option<&Collation>) -> Document {
    let mut named = same(id);
    if let (Bson::String(text), Some(_)) = (id, collation) {
        let length = i64::try_from(text.len()).unwrap_or(i64::MAX);
        let bytes = doc! { "$and": [
            { "$eq": [{ "$strLenBytes": "$_id" }, length] },
            { "$eq": [{ "$indexOfBytes": ["$_id", { "$literal": text }] }, 0] },
        ] };
        let is_text = doc! { "$eq": [{ "$type": "$_id" }, "string"] };
        named.insert("$expr", doc! { "$cond": [is_text, bytes, false] });
    }
    named
}

/// The filter for the documents with these `_id`s, in a request with this collation.
pub(super) fn among(ids: &[Bson], collation: Option<&Collation>) -> Document {
    match collation {
        None => doc! { "_id": { "$in": ids } },
        Some(_) => doc! { "$or": ids.iter().map(|id| exactly(id, collation)).collect::<Vec<_>>() },
    }
}

/// A filter that matches nothing and contains another, so that it is checked.
pub(super) fn none_of(filter: &Document) -> Document {
    doc! { "$and": [filter.clone(), { "_id": { "$in": [] } }] }
}
