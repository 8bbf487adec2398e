//! A borrowed value, in raw bytes or in an owned document.

use bson::oid::ObjectId;
use bson::{Bson, DbPointer, Decimal128, Document, RawBsonRef, RawDbPointerRef, RawDocument};

use super::element::{Element, Elements, sized, string, text_and_rest};
use super::number::Number;

/// A borrowed value. Documents and arrays are decoded only when their elements are read.
#[derive(Debug, Clone, Copy)]
pub(super) enum View<'a> {
    MinKey,
    Undefined,
    Null,
    Number(Number),
    String(&'a str),
    Symbol(&'a str),
    Document(Fields<'a>),
    Array(Items<'a>),
    Binary(u8, &'a [u8]),
    ObjectId(ObjectId),
    Bool(bool),
    Date(i64),
    Timestamp(u32, u32),
    Regex(&'a str, &'a str),
    DbPointer(Pointer<'a>),
    Code(&'a str),
    CodeWithScope(&'a str, Fields<'a>),
    MaxKey,
}

/// The deprecated pointer type, whose parts the `bson` crate keeps private.
#[derive(Debug, Clone, Copy)]
pub(super) enum Pointer<'a> {
    Raw(RawDbPointerRef<'a>),
    /// The bytes of its value.
    Bytes(&'a [u8]),
    Owned(&'a DbPointer),
}

impl Pointer<'_> {
    pub(super) fn to_owned(self) -> Bson {
        match self {
            Self::Raw(raw) => Bson::try_from(RawBsonRef::DbPointer(raw)).unwrap_or(Bson::Null),
            Self::Bytes(bytes) => pointer_of(bytes).unwrap_or(Bson::Null),
            Self::Owned(owned) => Bson::DbPointer(owned.clone()),
        }
    }

    /// Returns a text that is equal for equal pointers.
    pub(super) fn text(self) -> String {
        format!("{:?}", self.to_owned())
    }
}

/// Returns a pointer from its bytes, by way of a document that has nothing else.
fn pointer_of(bytes: &[u8]) -> Option<Bson> {
    let length = i32::try_from(bytes.len().checked_add(7)?).ok()?;
    let mut document = length.to_le_bytes().to_vec();
    document.extend([0x0C, 0]);
    document.extend(bytes);
    document.push(0);
    let document = Document::try_from(RawDocument::from_bytes(&document).ok()?).ok()?;
    document.into_iter().next().map(|(_, value)| value)
}

impl<'a> Element<'a> {
    /// Decodes the value; `None` if its bytes are invalid.
    pub(super) fn view(self) -> Option<View<'a>> {
        let value = self.value;
        Some(match self.type_code {
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

/// Decodes binary data; the old subtype has its length twice.
fn binary(value: &[u8]) -> Option<View<'_>> {
    let (subtype, bytes) = value.get(4..)?.split_first()?;
    let bytes = if *subtype == 0x02 { bytes.get(4..)? } else { bytes };
    Some(View::Binary(*subtype, bytes))
}

/// The fields of a document.
#[derive(Debug, Clone, Copy)]
pub(super) enum Fields<'a> {
    Raw(&'a RawDocument),
    Owned(&'a Document),
}

/// The elements of an array; a raw one is a document of indexes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Items<'a> {
    Raw(&'a RawDocument),
    Owned(&'a [Bson]),
}

impl<'a> From<RawBsonRef<'a>> for View<'a> {
    fn from(value: RawBsonRef<'a>) -> Self {
        match value {
            RawBsonRef::Double(value) => Self::Number(Number::Double(value)),
            RawBsonRef::String(value) => Self::String(value),
            RawBsonRef::Array(value) => match RawDocument::from_bytes(value.as_bytes()) {
                Ok(items) => Self::Array(Items::Raw(items)),
                Err(_) => Self::Array(Items::Owned(&[])),
            },
            RawBsonRef::Document(value) => Self::Document(Fields::Raw(value)),
            RawBsonRef::Boolean(value) => Self::Bool(value),
            RawBsonRef::Null => Self::Null,
            RawBsonRef::RegularExpression(value) => Self::Regex(value.pattern.as_str(), value.options.as_str()),
            RawBsonRef::JavaScriptCode(value) => Self::Code(value),
            RawBsonRef::JavaScriptCodeWithScope(value) => Self::CodeWithScope(value.code, Fields::Raw(value.scope)),
            RawBsonRef::Int32(value) => Self::Number(Number::Int(value)),
            RawBsonRef::Int64(value) => Self::Number(Number::Long(value)),
            RawBsonRef::Timestamp(value) => Self::Timestamp(value.time, value.increment),
            RawBsonRef::Binary(value) => Self::Binary(value.subtype.into(), value.bytes),
            RawBsonRef::ObjectId(value) => Self::ObjectId(value),
            RawBsonRef::DateTime(value) => Self::Date(value.timestamp_millis()),
            RawBsonRef::Symbol(value) => Self::Symbol(value),
            RawBsonRef::Decimal128(value) => Self::Number(Number::Decimal(value.into())),
            RawBsonRef::Undefined => Self::Undefined,
            RawBsonRef::MaxKey => Self::MaxKey,
            RawBsonRef::MinKey => Self::MinKey,
            RawBsonRef::DbPointer(value) => Self::DbPointer(Pointer::Raw(value)),
        }
    }
}

impl<'a> From<&'a Bson> for View<'a> {
    fn from(value: &'a Bson) -> Self {
        match value {
            Bson::Double(value) => Self::Number(Number::Double(*value)),
            Bson::String(value) => Self::String(value),
            Bson::Array(value) => Self::Array(Items::Owned(value)),
            Bson::Document(value) => Self::Document(Fields::Owned(value)),
            Bson::Boolean(value) => Self::Bool(*value),
            Bson::Null => Self::Null,
            Bson::RegularExpression(value) => Self::Regex(value.pattern.as_str(), value.options.as_str()),
            Bson::JavaScriptCode(value) => Self::Code(value),
            Bson::JavaScriptCodeWithScope(value) => Self::CodeWithScope(&value.code, Fields::Owned(&value.scope)),
            Bson::Int32(value) => Self::Number(Number::Int(*value)),
            Bson::Int64(value) => Self::Number(Number::Long(*value)),
            Bson::Timestamp(value) => Self::Timestamp(value.time, value.increment),
            Bson::Binary(value) => Self::Binary(value.subtype.into(), &value.bytes),
            Bson::ObjectId(value) => Self::ObjectId(*value),
            Bson::DateTime(value) => Self::Date(value.timestamp_millis()),
            Bson::Symbol(value) => Self::Symbol(value),
            Bson::Decimal128(value) => Self::Number(Number::Decimal((*value).into())),
            Bson::Undefined => Self::Undefined,
            Bson::MaxKey => Self::MaxKey,
            Bson::MinKey => Self::MinKey,
            Bson::DbPointer(value) => Self::DbPointer(Pointer::Owned(value)),
        }
    }
}

impl<'a> From<&'a RawDocument> for Fields<'a> {
    fn from(document: &'a RawDocument) -> Self {
        Self::Raw(document)
    }
}

impl<'a> From<&'a Document> for Fields<'a> {
    fn from(document: &'a Document) -> Self {
        Self::Owned(document)
    }
}

impl<'a> Fields<'a> {
    /// Returns the first field of that name. A damaged document ends at the damage.
    pub(super) fn get(self, name: &str) -> Option<View<'a>> {
        match self {
            Self::Raw(document) => Elements::new(document).find(name.as_bytes())?.view(),
            Self::Owned(document) => document.get(name).map(View::from),
        }
    }

    /// Returns the fields in order.
    pub(super) fn iter(self) -> FieldIter<'a> {
        match self {
            Self::Raw(document) => FieldIter::Raw(Elements::new(document)),
            Self::Owned(document) => FieldIter::Owned(document.iter()),
        }
    }

    /// Returns a copy of its own.
    pub(super) fn to_document(self) -> Document {
        match self {
            Self::Raw(document) => Document::try_from(document).unwrap_or_default(),
            Self::Owned(document) => document.clone(),
        }
    }
}

impl<'a> Items<'a> {
    pub(super) fn iter(self) -> ItemIter<'a> {
        match self {
            Self::Raw(array) => ItemIter::Raw(Elements::new(array)),
            Self::Owned(array) => ItemIter::Owned(array.iter()),
        }
    }

    pub(super) fn get(self, index: usize) -> Option<View<'a>> {
        match self {
            Self::Raw(array) => Elements::new(array).nth(index).and_then(Element::view),
            Self::Owned(array) => array.get(index).map(View::from),
        }
    }

    pub(super) fn len(self) -> usize {
        match self {
            Self::Raw(array) => Elements::new(array).count(),
            Self::Owned(array) => array.len(),
        }
    }

    pub(super) fn is_empty(self) -> bool {
        match self {
            Self::Raw(array) => array.is_empty(),
            Self::Owned(array) => array.is_empty(),
        }
    }

    /// Returns whether it is this array, not only an equal one.
    pub(super) fn is(self, other: Self) -> bool {
        match (self, other) {
            (Self::Raw(one), Self::Raw(other)) => std::ptr::eq(one, other),
            (Self::Owned(one), Self::Owned(other)) => std::ptr::eq(one, other),
            _ => false,
        }
    }

    /// Returns a copy of its own.
    pub(super) fn to_vec(self) -> Vec<Bson> {
        match self {
            Self::Raw(_) => self.iter().map(View::to_bson).collect(),
            Self::Owned(array) => array.to_vec(),
        }
    }
}

/// Iterates over fields.
pub(super) enum FieldIter<'a> {
    Raw(Elements<'a>),
    Owned(bson::document::Iter<'a>),
}

impl<'a> Iterator for FieldIter<'a> {
    type Item = (&'a str, View<'a>);

    fn next(&mut self) -> Option<Self::Item> {
        match self {
            Self::Raw(iter) => {
                let element = iter.next()?;
                Some((element.name()?, element.view()?))
            }
            Self::Owned(iter) => iter.next().map(|(name, value)| (name.as_str(), value.into())),
        }
    }
}

/// Iterates over elements.
pub(super) enum ItemIter<'a> {
    Raw(Elements<'a>),
    Owned(std::slice::Iter<'a, Bson>),
}

impl<'a> Iterator for ItemIter<'a> {
    type Item = View<'a>;

    fn next(&mut self) -> Option<Self::Item> {
        match self {
            Self::Raw(iter) => iter.next()?.view(),
            Self::Owned(iter) => iter.next().map(View::from),
        }
    }
}

impl View<'_> {
    /// Returns a copy of its own.
    pub(super) fn to_bson(self) -> Bson {
        match self {
            Self::MinKey => Bson::MinKey,
            Self::Undefined => Bson::Undefined,
            Self::Null => Bson::Null,
            Self::Number(number) => number.into(),
            Self::String(text) => Bson::String(text.to_owned()),
            Self::Symbol(text) => Bson::Symbol(text.to_owned()),
            Self::Document(fields) => Bson::Document(fields.to_document()),
            Self::Array(items) => Bson::Array(items.to_vec()),
            Self::Binary(subtype, bytes) => {
                Bson::Binary(bson::Binary { subtype: subtype.into(), bytes: bytes.to_vec() })
            }
            Self::ObjectId(id) => Bson::ObjectId(id),
            Self::Bool(value) => Bson::Boolean(value),
            Self::Date(millis) => Bson::DateTime(bson::DateTime::from_millis(millis)),
            Self::Timestamp(time, increment) => Bson::Timestamp(bson::Timestamp { time, increment }),
            Self::Regex(pattern, options) => match (pattern.to_owned().try_into(), options.to_owned().try_into()) {
                (Ok(pattern), Ok(options)) => Bson::RegularExpression(bson::Regex { pattern, options }),
                _ => Bson::Null,
            },
            Self::DbPointer(pointer) => pointer.to_owned(),
            Self::Code(code) => Bson::JavaScriptCode(code.to_owned()),
            Self::CodeWithScope(code, scope) => Bson::JavaScriptCodeWithScope(bson::JavaScriptCodeWithScope {
                code: code.to_owned(),
                scope: scope.to_document(),
            }),
            Self::MaxKey => Bson::MaxKey,
        }
    }

    /// BSON's code of the type.
    pub(super) fn type_code(self) -> i32 {
        match self {
            Self::MinKey => -1,
            Self::Undefined => 6,
            Self::Null => 10,
            Self::Number(Number::Double(_)) => 1,
            Self::Number(Number::Int(_)) => 16,
            Self::Number(Number::Long(_)) => 18,
            Self::Number(Number::Decimal(_)) => 19,
            Self::String(_) => 2,
            Self::Symbol(_) => 14,
            Self::Document(_) => 3,
            Self::Array(_) => 4,
            Self::Binary(..) => 5,
            Self::ObjectId(_) => 7,
            Self::Bool(_) => 8,
            Self::Date(_) => 9,
            Self::Timestamp(..) => 17,
            Self::Regex(..) => 11,
            Self::DbPointer(_) => 12,
            Self::Code(_) => 13,
            Self::CodeWithScope(..) => 15,
            Self::MaxKey => 127,
        }
    }

    /// MongoDB's name of the type.
    pub(super) fn type_name(self) -> &'static str {
        TYPE_NAMES.iter().find(|(_, code)| *code == self.type_code()).map_or("missing", |(name, _)| name)
    }

    /// MongoDB's idea of truth: everything but false, null, undefined and zero.
    pub(super) fn truthy(self) -> bool {
        match self {
            Self::Null | Self::Undefined => false,
            Self::Bool(value) => value,
            Self::Number(number) => !number.is_zero(),
            _ => true,
        }
    }
}

/// MongoDB's name of the type of a value, as `$type` gives it.
#[must_use]
pub fn type_name(value: &Bson) -> &'static str {
    View::from(value).type_name()
}

/// Names of types with their codes.
pub(super) const TYPE_NAMES: [(&str, i32); 21] = [
    ("double", 1),
    ("string", 2),
    ("object", 3),
    ("array", 4),
    ("binData", 5),
    ("undefined", 6),
    ("objectId", 7),
    ("bool", 8),
    ("date", 9),
    ("null", 10),
    ("regex", 11),
    ("dbPointer", 12),
    ("javascript", 13),
    ("symbol", 14),
    ("javascriptWithScope", 15),
    ("int", 16),
    ("timestamp", 17),
    ("long", 18),
    ("decimal", 19),
    ("minKey", -1),
    ("maxKey", 127),
];

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{Binary, RawDocumentBuf, doc};

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
