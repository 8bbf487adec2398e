//! The `_id`s of documents, filters for documents with known ones, and what filters have.

use bson::{Bson, Document, RawDocument, doc};

use crate::query::{Collation, QueryError};

/// The longest text, in bytes, by which an index is asked beside its bytes: a command has room for 16 MB.
const LONG_TEXT: usize = 1 << 20;

/// The `_id` of a document.
pub(super) fn id_of(document: &RawDocument) -> Result<Bson, QueryError> {
    let id = document.get("_id")?.map(Bson::try_from).transpose()?;
    Ok(id.unwrap_or(Bson::Null))
}

/// The filter for the document with an `_id`.
pub(super) fn same(id: &Bson) -> Document {
    doc! { "_id": { "$eq": id } }
}

/// The same for a request with a collation, in which texts that differ may be equal: by their lengths and bytes, which the
/// server compares without it.
pub(super) fn exactly(id: &Bson, collation: Option<&Collation>) -> Document {
    if let (Bson::String(text), Some(_)) = (id, collation)
        && text.len() > LONG_TEXT
    {
        return doc! { "$expr": is_text("$_id".into(), text) };
    }
    let mut named = same(id);
    let mut texts = Vec::new();
    if collation.is_some() {
        add_texts(id, "$_id".into(), &mut texts);
    }
    if !texts.is_empty() {
        // What is equal has them in the same places.
        let is_equal = doc! { "$eq": ["$_id", { "$literal": id }] };
        named.insert("$expr", doc! { "$cond": [is_equal, { "$and": texts }, false] });
    }
    named
}

/// Adds a condition for each text within a value, which an expression gives.
fn add_texts(value: &Bson, given: Bson, texts: &mut Vec<Document>) {
    match value {
        Bson::String(text) => {
            texts.push(is_text(given, text));
        }
        Bson::Document(fields) => fields.iter().for_each(|(name, value)| add_texts(value, field(&given, name), texts)),
        Bson::Array(items) => {
            for (place, item) in items.iter().enumerate() {
                let place = i64::try_from(place).unwrap_or(i64::MAX);
                add_texts(item, doc! { "$arrayElemAt": [&given, place] }.into(), texts);
            }
        }
        _ => {}
    }
}

/// The expression whether another one gives a text, byte by byte.
fn is_text(given: Bson, text: &str) -> Document {
    let length = i64::try_from(text.len()).unwrap_or(i64::MAX);
    let is_text = doc! { "$eq": [{ "$type": &given }, "string"] };
    let has_length = doc! { "$eq": [{ "$strLenBytes": &given }, length] };
    let has_bytes = doc! { "$eq": [{ "$indexOfBytes": [given, { "$literal": text }] }, 0] };
    doc! { "$cond": [is_text, { "$and": [has_length, has_bytes] }, false] }
}

/// The expression for a field of the document that another one gives. Servers before MongoDB 5.0 know only paths.
fn field(given: &Bson, name: &str) -> Bson {
    match given {
        Bson::String(path) if !name.is_empty() && !name.starts_with('$') && !name.contains('.') => {
            format!("{path}.{name}").into()
        }
        _ => doc! { "$getField": { "field": { "$literal": name }, "input": given } }.into(),
    }
}

/// The filter for the documents with these `_id`s, in a request with this collation.
pub(super) fn among(ids: &[Bson], collation: Option<&Collation>) -> Document {
    if let ([id], Some(_)) = (ids, collation) {
        return exactly(id, collation);
    }
    let mut among = doc! { "_id": { "$in": ids } };
    if collation.is_some() {
        among.insert("$or", ids.iter().map(|id| exactly(id, collation)).collect::<Vec<_>>());
    }
    among
}

/// What a filter asks for beside that the `_id` is a value, or one of some: of a document that matched, that is known, since it
/// keeps its `_id`.
pub(super) fn beside_ids(filter: &Document) -> Document {
    let is_known = |name: &str, value: &Bson| {
        name == "_id"
            && match value {
                Bson::Document(asked) => !asked.is_empty() && asked.keys().all(|key| key == "$in" || key == "$eq"),
                Bson::RegularExpression(_) => false,
                _ => true,
            }
    };
    let within = |(name, value): (&String, &Bson)| match value {
        Bson::Array(parts) if name == "$and" && parts.iter().all(|part| part.as_document().is_some()) => {
            let parts = parts.iter().filter_map(Bson::as_document).map(beside_ids);
            (name.clone(), parts.collect::<Vec<_>>().into())
        }
        _ => (name.clone(), value.clone()),
    };
    filter.iter().filter(|(name, value)| !is_known(name, value)).map(within).collect()
}

/// A filter that matches nothing and contains another, so that it is checked.
pub(super) fn none_of(filter: &Document) -> Document {
    doc! { "$and": [filter.clone(), { "_id": { "$in": [] } }] }
}

/// Whether a filter has one of these operators somewhere.
pub(super) fn has_operator(filter: &Document, operators: &[&str]) -> bool {
    let within = |value: &Bson| match value {
        Bson::Document(fields) => has_operator(fields, operators),
        Bson::Array(items) => items.iter().filter_map(Bson::as_document).any(|item| has_operator(item, operators)),
        _ => false,
    };
    filter.iter().any(|(name, value)| operators.contains(&name.as_str()) || within(value))
}
