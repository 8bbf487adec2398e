//! Elements of a document in their bytes: found by name without decoding the others.
//!
//! An element is a type byte, a name that ends in NUL, and a value whose length
//! the type tells (<https://bsonspec.org/spec.html>). What is damaged ends the
//! walk quietly.

use bson::oid::ObjectId;
use bson::{Decimal128, RawDocument};

use super::number::Number;
use super::view::{Fields, Items, Pointer, View};

/// The bytes of the elements that are left.
#[derive(Debug, Clone)]
pub(super) struct Elements<'a> {
    rest: &'a [u8],
}

/// One element, its value not yet decoded.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element<'a> {
    kind: u8,
    name: &'a [u8],
    value: &'a [u8],
}

impl<'a> Elements<'a> {
    pub(super) fn new(document: &'a RawDocument) -> Self {
        Self { rest: document.as_bytes().get(4..).unwrap_or_default() }
    }

    /// The first element of that name.
    pub(super) fn find(mut self, name: &[u8]) -> Option<Element<'a>> {
        loop {
            let (kind, rest) = self.rest.split_first()?;
            if let Some([0, value @ ..]) = rest.strip_prefix(name)
                && !name.contains(&0)
            {
                let value = value.get(..length(*kind, value)?)?;
                return Some(Element { kind: *kind, name: rest.get(..name.len())?, value });
            }
            let (_, value) = text_and_rest(rest)?;
            self.rest = value.get(length(*kind, value)?..)?;
        }
    }
}

impl<'a> Iterator for Elements<'a> {
    type Item = Element<'a>;

    fn next(&mut self) -> Option<Element<'a>> {
        let (kind, rest) = self.rest.split_first()?;
        let (name, rest) = text_and_rest(rest)?;
        let (value, rest) = rest.split_at_checked(length(*kind, rest)?)?;
        self.rest = rest;
        Some(Element { kind: *kind, name, value })
    }
}

impl<'a> Element<'a> {
    /// Its name, where it is UTF-8.
    pub(super) fn name(self) -> Option<&'a str> {
        std::str::from_utf8(self.name).ok()
    }

    /// Its value, where it is sound.
    pub(super) fn view(self) -> Option<View<'a>> {
        let value = self.value;
        Some(match self.kind {
            0x01 => View::Number(Number::Double(f64::from_le_bytes(value.try_into().ok()?))),
            0x02 => View::String(string(value)?),
            0x03 => View::Document(Fields::Raw(RawDocument::from_bytes(value).ok()?)),
            0x04 => View::Array(Items::Raw(RawDocument::from_bytes(value).ok()?)),
            0x05 => binary(value)?,
            0x06 => View::Undefined,
            0x07 => View::ObjectId(ObjectId::from_bytes(value.try_into().ok()?)),
            0x08 => View::Bool(match value {
                [0] => false,
                [1] => true,
                _ => return None,
            }),
            0x09 => View::Date(i64::from_le_bytes(value.try_into().ok()?)),
            0x0A => View::Null,
            0x0B => {
                let (pattern, rest) = text_and_rest(value)?;
                let (options, _) = text_and_rest(rest)?;
                View::Regex(std::str::from_utf8(pattern).ok()?, std::str::from_utf8(options).ok()?)
            }
            0x0C => View::DbPointer(Pointer::Bytes(value)),
            0x0D => View::Code(string(value)?),
            0x0E => View::Symbol(string(value)?),
            0x0F => {
                let code = value.get(4..)?;
                let (code, scope) = code.split_at_checked(sized(code, 4)?)?;
                View::CodeWithScope(string(code)?, Fields::Raw(RawDocument::from_bytes(scope).ok()?))
            }
            0x10 => View::Number(Number::Int(i32::from_le_bytes(value.try_into().ok()?))),
            0x11 => {
                let (increment, time) = value.split_at_checked(4)?;
                View::Timestamp(
                    u32::from_le_bytes(time.try_into().ok()?),
                    u32::from_le_bytes(increment.try_into().ok()?),
                )
            }
            0x12 => View::Number(Number::Long(i64::from_le_bytes(value.try_into().ok()?))),
            0x13 => View::Number(Number::Decimal(Decimal128::from_bytes(value.try_into().ok()?).into())),
            0x7F => View::MaxKey,
            0xFF => View::MinKey,
            _ => return None,
        })
    }
}

/// How many bytes a value takes.
fn length(kind: u8, bytes: &[u8]) -> Option<usize> {
    Some(match kind {
        0x06 | 0x0A | 0x7F | 0xFF => 0,
        0x08 => 1,
        0x10 => 4,
        0x01 | 0x09 | 0x11 | 0x12 => 8,
        0x07 => 12,
        0x13 => 16,
        0x02 | 0x0D | 0x0E => sized(bytes, 4)?,
        0x05 => sized(bytes, 5)?,
        0x0C => sized(bytes, 16)?,
        0x03 | 0x04 | 0x0F => sized(bytes, 0)?,
        0x0B => {
            let (_, rest) = text_and_rest(bytes)?;
            let (_, rest) = text_and_rest(rest)?;
            bytes.len() - rest.len()
        }
        _ => return None,
    })
}

/// The length that the bytes begin with, and so many more.
fn sized(bytes: &[u8], more: usize) -> Option<usize> {
    let length = i32::from_le_bytes(*bytes.first_chunk()?);
    usize::try_from(length).ok()?.checked_add(more)
}

/// The bytes before the next NUL and those after it.
fn text_and_rest(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let end = bytes.iter().position(|byte| *byte == 0)?;
    let (text, rest) = bytes.split_at_checked(end)?;
    Some((text, rest.get(1..)?))
}

/// A text after its length and before its NUL.
fn string(value: &[u8]) -> Option<&str> {
    let (0, text) = value.get(4..)?.split_last()? else { return None };
    std::str::from_utf8(text).ok()
}

/// Binary data; the old subtype has its length twice.
fn binary(value: &[u8]) -> Option<View<'_>> {
    let (subtype, bytes) = value.get(4..)?.split_first()?;
    let bytes = if *subtype == 0x02 { bytes.get(4..)? } else { bytes };
    Some(View::Binary(*subtype, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{Binary, Bson, DbPointer, Document, RawDocumentBuf, doc};

    fn every_type() -> Document {
        let pointer: DbPointer = serde_json::from_value::<Bson>(
            serde_json::json!({"$dbPointer": {"$ref": "a.b", "$id": {"$oid": "507f1f77bcf86cd799439011"}}}),
        )
        .ok()
        .and_then(|value| if let Bson::DbPointer(pointer) = value { Some(pointer) } else { None })
        .unwrap();
        doc! {
            "double": 1.5, "string": "ü", "document": {"a": 1}, "array": [1, "x"],
            "binary": Binary { subtype: bson::spec::BinarySubtype::Generic, bytes: vec![1, 0, 2] },
            "old": Binary { subtype: bson::spec::BinarySubtype::BinaryOld, bytes: vec![1, 2] },
            "undefined": Bson::Undefined, "id": ObjectId::from_bytes([7; 12]), "bool": true,
            "date": bson::DateTime::from_millis(-5), "null": Bson::Null,
            "regex": bson::Regex { pattern: "^a".try_into().unwrap(), options: "i".try_into().unwrap() },
            "pointer": Bson::DbPointer(pointer), "code": Bson::JavaScriptCode("f()".to_owned()),
            "symbol": Bson::Symbol("s".to_owned()),
            "scope": bson::JavaScriptCodeWithScope { code: "g()".to_owned(), scope: doc! {"b": 2} },
            "int": 3, "timestamp": bson::Timestamp { time: 4, increment: 5 }, "long": 6i64,
            "decimal": "0.1".parse::<Decimal128>().unwrap(), "max": Bson::MaxKey, "min": Bson::MinKey,
        }
    }

    #[test]
    fn every_type_is_found_and_reads_as_it_was_written() {
        let document = every_type();
        let raw = RawDocumentBuf::try_from(&document).unwrap();
        for (name, value) in &document {
            let found = Elements::new(&raw).find(name.as_bytes()).and_then(Element::view).unwrap();
            assert_eq!(&found.to_bson(), value, "{name}");
        }
        assert_eq!(Elements::new(&raw).count(), document.len());
        assert!(Elements::new(&raw).find(b"doubl").is_none());
    }

    #[test]
    fn a_changed_byte_ends_the_walk_without_a_panic() {
        let whole = RawDocumentBuf::try_from(&every_type()).unwrap().into_bytes();
        for place in 4..whole.len() - 1 {
            for byte in [0, 1, 2, 3, 15, 127, 128, 255] {
                let mut bytes = whole.clone();
                bytes[place] = byte;
                let raw = RawDocument::from_bytes(&bytes).unwrap();
                let values: Vec<Bson> = Elements::new(raw).filter_map(Element::view).map(View::to_bson).collect();
                assert!(values.len() <= whole.len());
            }
        }
    }
}
