//! Decoding documents: from bytes to values, in one pass.
//!
//! The types that nearly every document has are decoded here; a document with another type, and one that is not as it has
//! to be, is left to the library, which says what is wrong with it.

use bson::oid::ObjectId;
use bson::spec::BinarySubtype;
use bson::{Binary, Bson, DateTime, Document, RawDocument, Timestamp};

use super::element::{Element, Elements, string};
use super::error::Result;
use super::nesting::{MAX_DEPTH, check};

/// Returns a document from outside as values.
///
/// # Errors
/// If the bytes are invalid or nested too deeply, as [`check`](super::check) says.
pub fn decode(document: &RawDocument) -> Result<Document> {
    decode_but(document, "")
}

/// The same, with null in place of a document of that name, which is not read.
///
/// # Errors
/// As above; the document that is not read has to be valid, too.
pub fn decode_but(document: &RawDocument, unread: &str) -> Result<Document> {
    let mut decoded = Document::new();
    if fields(document.as_bytes(), MAX_DEPTH, unread, &mut decoded).is_some() {
        return Ok(decoded);
    }
    check(document)?;
    Ok(Document::try_from(document)?)
}

/// Decodes the fields of a document of at most so many levels; none where the library has to do so.
fn fields(bytes: &[u8], levels: usize, unread: &str, decoded: &mut Document) -> Option<()> {
    for element in elements(bytes, levels)? {
        let element = element?;
        let name = element.name()?;
        let is_read = element.type_code != 0x03 || unread.is_empty() || name != unread;
        decoded.insert(name, if is_read { value(element, levels)? } else { valid(element.value, levels - 1)? });
    }
    Some(())
}

/// Null in place of a valid document or array of at most so many levels.
fn valid(bytes: &[u8], levels: usize) -> Option<Bson> {
    for element in elements(bytes, levels)? {
        let element = element?;
        element.name()?;
        match element.type_code {
            0x03 | 0x04 => valid(element.value, levels - 1)?,
            _ => value(element, levels)?,
        };
    }
    Some(Bson::Null)
}

/// The values of an array of at most so many levels.
fn items(bytes: &[u8], levels: usize) -> Option<Vec<Bson>> {
    let mut decoded = Vec::new();
    for element in elements(bytes, levels)? {
        let element = element?;
        element.name()?;
        decoded.push(value(element, levels)?);
    }
    Some(decoded)
}

/// The elements of a document, and nothing in place of what is damaged.
fn elements(bytes: &[u8], levels: usize) -> Option<impl Iterator<Item = Option<Element<'_>>>> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    let (0, inner) = rest.split_last()? else { return None };
    if levels == 0 || usize::try_from(i32::from_le_bytes(*length)) != Ok(bytes.len()) {
        return None;
    }
    let mut elements = Elements::of(inner);
    Some(std::iter::from_fn(move || match elements.next() {
        None if elements.is_at_end() => None,
        found => Some(found),
    }))
}

fn value(element: Element<'_>, levels: usize) -> Option<Bson> {
    let bytes = element.value;
    Some(match element.type_code {
        0x01 => Bson::Double(f64::from_le_bytes(bytes.try_into().ok()?)),
        0x02 => Bson::String(string(bytes)?.to_owned()),
        0x03 => {
            let mut inner = Document::new();
            fields(bytes, levels - 1, "", &mut inner)?;
            Bson::Document(inner)
        }
        0x04 => Bson::Array(items(bytes, levels - 1)?),
        0x05 => Bson::Binary(binary(bytes)?),
        0x07 => Bson::ObjectId(ObjectId::from_bytes(bytes.try_into().ok()?)),
        0x08 => Bson::Boolean(match bytes {
            [0] => false,
            [1] => true,
            _ => return None,
        }),
        0x09 => Bson::DateTime(DateTime::from_millis(i64::from_le_bytes(bytes.try_into().ok()?))),
        0x0A => Bson::Null,
        0x10 => Bson::Int32(i32::from_le_bytes(bytes.try_into().ok()?)),
        0x11 => {
            let (increment, time) = bytes.split_at_checked(4)?;
            let number = |bytes: &[u8]| Some(u32::from_le_bytes(bytes.try_into().ok()?));
            Bson::Timestamp(Timestamp { time: number(time)?, increment: number(increment)? })
        }
        0x12 => Bson::Int64(i64::from_le_bytes(bytes.try_into().ok()?)),
        _ => return None,
    })
}

/// Bytes whose type needs no more than its number.
fn binary(bytes: &[u8]) -> Option<Binary> {
    let subtype = *bytes.get(4)?;
    // The old form of binaries has a second length.
    if subtype == 2 {
        return None;
    }
    Some(Binary { subtype: BinarySubtype::from(subtype), bytes: bytes.get(5..)?.to_vec() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{Decimal128, RawDocumentBuf, Regex, doc};

    /// What the library decodes, where the document is acceptable.
    fn expected(raw: &RawDocument) -> Option<Document> {
        check(raw).ok()?;
        Document::try_from(raw).ok()
    }

    fn samples() -> Vec<Document> {
        let uuid = Binary { subtype: BinarySubtype::Uuid, bytes: vec![7; 16] };
        let old = Binary { subtype: BinarySubtype::BinaryOld, bytes: vec![1, 2] };
        let plain = doc! {
            "": 1.5, "text": "a\0ü", "none": Bson::Null, "yes": true, "no": false, "n": 7, "long": -7_i64,
            "id": ObjectId::from_bytes([3; 12]), "at": DateTime::from_millis(-1), "uuid": uuid,
            "stamp": Timestamp { time: 5, increment: 9 }, "in": { "a": [1, "x", { "b": [] }, {}] },
        };
        let rare = doc! {
            "old": old, "regex": Regex { pattern: "a".try_into().unwrap(), options: "i".try_into().unwrap() },
            "decimal": "1.25".parse::<Decimal128>().unwrap(), "code": Bson::JavaScriptCode("1".into()),
            "low": Bson::MinKey, "high": Bson::MaxKey, "undefined": Bson::Undefined, "in": { "symbol": Bson::Symbol("s".into()) },
        };
        vec![doc! {}, plain, rare]
    }

    #[test]
    fn documents_are_decoded_as_the_library_does() {
        for document in samples() {
            let raw = RawDocumentBuf::try_from(&document).unwrap();
            assert_eq!(decode(&raw).unwrap(), document);
        }
        let twice = b"\x13\0\0\0\x10a\0\x01\0\0\0\x10a\0\x02\0\0\0\0";
        let twice = RawDocument::from_bytes(twice).unwrap();
        assert_eq!(decode(twice).unwrap(), expected(twice).unwrap());
    }

    #[test]
    fn a_document_that_is_not_read_has_to_be_valid() {
        let inner = doc! { "b": [1, { "c": 2 }] };
        let raw = RawDocumentBuf::try_from(&doc! { "a": inner.clone(), "in": { "a": 1 }, "d": 2 }).unwrap();
        assert_eq!(decode_but(&raw, "a").unwrap(), doc! { "a": Bson::Null, "in": { "a": 1 }, "d": 2 });
        let mut damaged = raw.into_bytes();
        let at = damaged.windows(2).position(|bytes| bytes == b"c\0").unwrap();
        damaged[at - 1] = 0x7E;
        assert!(decode_but(RawDocument::from_bytes(&damaged).unwrap(), "a").is_err());
        let other = RawDocumentBuf::try_from(&doc! { "a": 1, "d": inner }).unwrap();
        assert_eq!(decode_but(&other, "a").unwrap(), decode(&other).unwrap());
    }

    #[test]
    fn what_is_damaged_or_too_deep_is_refused_as_by_the_library() {
        let mut compared = 0;
        for document in samples() {
            let sound = RawDocumentBuf::try_from(&document).unwrap().into_bytes();
            for at in 4..sound.len() {
                for value in [0, 1, 2, 3, 5, 8, 0x0B, 0x7F, 0xFF, sound[at] ^ 1, sound[at] ^ 0x80] {
                    let mut bytes = sound.clone();
                    bytes[at] = value;
                    let Ok(raw) = RawDocument::from_bytes(&bytes) else { continue };
                    // Documents print alike where they are alike, also with NaN.
                    assert_eq!(format!("{:?}", decode(raw).ok()), format!("{:?}", expected(raw)), "{value} at {at}");
                    compared += 1;
                }
            }
        }
        assert!(compared > 2_000);
        let mut nested = doc! {};
        for levels in 2..=205 {
            nested = if levels % 2 == 0 {
                doc! { "a": nested }
            } else {
                doc! { "a": [nested] }
            };
            let raw = RawDocumentBuf::try_from(&nested).unwrap();
            assert_eq!(decode(&raw).is_ok(), check(&raw).is_ok(), "{levels}");
        }
    }
}
