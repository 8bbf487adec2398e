//! What may be stored, and in which form: MongoDB 6's rules.

use std::sync::atomic::{AtomicU32, Ordering};

use bson::raw::{RawBsonRef, RawElement};
use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf, Timestamp, rawdoc};

use crate::query::{QueryError, check_id_names, object_id};

/// The most bytes of a document, in BSON.
pub const MAX_SIZE: usize = 16 << 20;
/// How deep documents and arrays may be nested, the document itself included.
pub const MAX_DEPTH: usize = 180;

/// The document as it is stored: `_id` first, made up where there was none, and
/// empty timestamps at the top replaced by the time.
pub(crate) fn settle(mut document: Document) -> Result<(Bson, RawDocumentBuf), QueryError> {
    check_depth(&document)?;
    fill_timestamps(&mut document);
    let encoded = |document: &Document| {
        RawDocumentBuf::try_from(document)
            .map_err(|error| QueryError::invalid(2, format!("the document cannot be stored: {error}")))
    };
    let (id, body) = match document.get("_id").cloned() {
        Some(id) => {
            check_id(&id)?;
            let body = encoded(&with_id_first(document, &id))?;
            (id, body)
        }
        None => {
            let id = object_id::new();
            (Bson::ObjectId(id), joined(&rawdoc! { "_id": id }, &encoded(&document)?)?)
        }
    };
    check_size(&body)?;
    Ok((id, body))
}

/// A document with the elements of two.
fn joined(first: &RawDocument, second: &RawDocument) -> Result<RawDocumentBuf, QueryError> {
    // Each begins with its length and ends with a NUL.
    let elements = first.as_bytes().split_last().map(|(_, elements)| elements).unwrap_or_default();
    let mut bytes = [elements, second.as_bytes().get(4..).unwrap_or_default()].concat();
    let size = i32::try_from(bytes.len()).unwrap_or(i32::MAX);
    bytes.get_mut(..4).into_iter().for_each(|length| length.copy_from_slice(&size.to_le_bytes()));
    Ok(RawDocumentBuf::from_bytes(bytes)?)
}

/// The document with further keys, which it does not have, behind its own.
///
/// # Errors
/// Where it becomes too large or too deep.
pub(crate) fn extend(document: &RawDocument, mut keys: Document) -> Result<RawDocumentBuf, QueryError> {
    check_depth(&keys)?;
    fill_timestamps(&mut keys);
    let keys = RawDocumentBuf::try_from(&keys)?;
    let extended = joined(document, &keys)?;
    check_size(&extended)?;
    Ok(extended)
}

/// Whether a document may be stored.
pub(crate) fn check(document: &Document) -> Result<(), QueryError> {
    check_depth(document)?;
    if let Some(id) = document.get("_id") {
        check_id(id)?;
    }
    check_size(&RawDocumentBuf::try_from(document)?)
}

/// Checks the size and the depth of a document.
pub(crate) fn check_shape(document: &RawDocument) -> Result<(), QueryError> {
    check_size(document)?;
    check_raw_depth(document)
}

/// Checks a document that an update made, and gives its `_id`.
pub(crate) fn vet(document: &RawDocument) -> Result<Bson, QueryError> {
    check_shape(document)?;
    let Some(id) = document.get("_id")? else {
        return Err(QueryError::invalid(2, "the document has no _id"));
    };
    let id = Bson::try_from(id)?;
    check_id(&id)?;
    Ok(id)
}

/// The document with `id` as its first key.
pub(crate) fn with_id_first(document: Document, id: &Bson) -> Document {
    if document.keys().next().is_some_and(|first| first == "_id") {
        return document;
    }
    let mut settled = Document::new();
    settled.insert("_id", id.clone());
    settled.extend(document.into_iter().filter(|(key, _)| key != "_id"));
    settled
}

/// Returns the time to the document's own fields that hold an empty timestamp.
/// No two get the same.
pub(crate) fn fill_timestamps(document: &mut Document) {
    static INCREMENT: AtomicU32 = AtomicU32::new(0);
    let empty = Bson::Timestamp(Timestamp { time: 0, increment: 0 });
    for (_, value) in document.iter_mut().filter(|(name, value)| *name != "_id" && **value == empty) {
        // A clock before 1970 or after 2106 gives the nearest time, which is not empty.
        let seconds = (DateTime::now().timestamp_millis() / 1_000).clamp(1, i64::from(u32::MAX));
        let time = u32::try_from(seconds).unwrap_or(u32::MAX);
        let increment = INCREMENT.fetch_add(1, Ordering::Relaxed).wrapping_add(1);
        *value = Bson::Timestamp(Timestamp { time, increment });
    }
}

fn check_size(document: &RawDocument) -> Result<(), QueryError> {
    let size = document.as_bytes().len();
    if size <= MAX_SIZE {
        return Ok(());
    }
    Err(QueryError::invalid(10334, format!("the document has {size} bytes, more than the {MAX_SIZE} that are allowed")))
}

fn check_id(id: &Bson) -> Result<(), QueryError> {
    let kind = match id {
        Bson::Array(_) => "an array",
        Bson::RegularExpression(_) => "a regular expression",
        Bson::Undefined => "undefined",
        Bson::Document(_) => return check_id_names(id),
        _ => return Ok(()),
    };
    Err(QueryError::invalid(53, format!("the _id may not be {kind}")))
}

/// Refuses what is nested too deeply, before anything walks it by recursion.
fn check_depth(document: &Document) -> Result<(), QueryError> {
    let mut level: Vec<&Bson> = document.values().flat_map(children).collect();
    for _ in 1..MAX_DEPTH {
        if level.is_empty() {
            break;
        }
        level = level.into_iter().flat_map(children).collect();
    }
    if level.is_empty() { Ok(()) } else { Err(too_deep()) }
}

fn children(value: &Bson) -> Box<dyn Iterator<Item = &Bson> + '_> {
    match value {
        Bson::Document(document) => Box::new(document.values()),
        Bson::Array(values) => Box::new(values.iter()),
        Bson::JavaScriptCodeWithScope(code) => Box::new(code.scope.values()),
        _ => Box::new(std::iter::empty()),
    }
}

fn check_raw_depth(document: &RawDocument) -> Result<(), QueryError> {
    let mut level = vec![document.iter_elements()];
    for _ in 0..MAX_DEPTH {
        let mut deeper = Vec::new();
        for element in level.into_iter().flatten() {
            deeper.extend(inside(&element?)?);
        }
        if deeper.is_empty() {
            return Ok(());
        }
        level = deeper;
    }
    Err(too_deep())
}

/// The elements of a value that has some.
fn inside<'a>(element: &RawElement<'a>) -> Result<Option<bson::raw::RawIter<'a>>, QueryError> {
    use bson::spec::ElementType::{Array, EmbeddedDocument};
    if !matches!(element.element_type(), Array | EmbeddedDocument) {
        return Ok(None);
    }
    Ok(match element.value()? {
        RawBsonRef::Document(document) => Some(document.iter_elements()),
        RawBsonRef::Array(array) => Some(array.iter_elements()),
        _ => None,
    })
}

fn too_deep() -> QueryError {
    QueryError::invalid(15, format!("the document is nested more than {MAX_DEPTH} levels deep"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn the_id_comes_first() {
        let (id, body) = settle(doc! { "a": 1, "_id": 7 }).unwrap();
        assert_eq!(id, Bson::Int32(7));
        let keys: Vec<_> = body.iter().map(|element| element.unwrap().0.to_string()).collect();
        assert_eq!(keys, ["_id", "a"]);
    }

    #[test]
    fn an_id_is_made_where_there_is_none() {
        let (first, _) = settle(doc! {}).unwrap();
        let (second, _) = settle(doc! {}).unwrap();
        assert!(matches!((&first, &second), (Bson::ObjectId(_), Bson::ObjectId(_))));
        assert_ne!(first, second);
    }

    #[test]
    fn an_empty_timestamp_at_the_top_becomes_the_time() {
        let empty = Timestamp { time: 0, increment: 0 };
        let (_, body) = settle(doc! { "a": empty, "b": empty, "c": { "d": empty } }).unwrap();
        let time = |name| body.get_timestamp(name).unwrap();
        assert!(time("a").time > 1_700_000_000);
        assert_ne!(time("a"), time("b"));
        assert_eq!(body.get_document("c").unwrap().get_timestamp("d").unwrap(), empty);
    }

    #[test]
    fn refuses_ids_that_mongodb_refuses() {
        let regex = bson::Regex { pattern: "a".try_into().unwrap(), options: "".try_into().unwrap() };
        for id in [Bson::Array(vec![]), Bson::Undefined, Bson::RegularExpression(regex), doc! { "$a": 1 }.into()] {
            assert!(settle(doc! { "_id": id.clone() }).is_err(), "{id}");
        }
    }

    #[test]
    fn refuses_more_levels_than_mongodb() {
        let nested = |levels: usize| (1..levels).fold(doc! { "_id": 1 }, |inner, _| doc! { "_id": 1, "a": inner });
        assert!(settle(nested(MAX_DEPTH)).is_ok());
        assert_eq!(settle(nested(MAX_DEPTH + 1)).unwrap_err().code, 15);
        assert!(vet(&RawDocumentBuf::try_from(&nested(MAX_DEPTH)).unwrap()).is_ok());
        assert_eq!(vet(&RawDocumentBuf::try_from(&nested(MAX_DEPTH + 1)).unwrap()).unwrap_err().code, 15);
    }

    #[test]
    fn refuses_sixteen_mebibytes_and_more() {
        let sized = |bytes: usize| doc! { "_id": 1, "a": "x".repeat(bytes) };
        let around = settle(sized(0)).unwrap().1.as_bytes().len();
        assert!(settle(sized(MAX_SIZE - around)).is_ok());
        assert_eq!(settle(sized(MAX_SIZE - around + 1)).unwrap_err().code, 10334);
    }
}
