//! Extended JSON: documents that stand for a value of another type.
//! Source: the Extended JSON specification v2, and version 1's `$binary` with `$type`.

use bson::spec::BinarySubtype;
use bson::{Binary, Bson, DateTime, Decimal128, Document, JavaScriptCodeWithScope, Timestamp, Uuid, oid::ObjectId};

use super::{date, literal};

/// The keys that only Extended JSON uses. `$regex` and `$type` are query operators as well, so they are not here.
const WRAPPERS: [&str; 18] = [
    "$oid",
    "$symbol",
    "$numberInt",
    "$numberLong",
    "$numberDouble",
    "$numberDecimal",
    "$binary",
    "$uuid",
    "$code",
    "$scope",
    "$timestamp",
    "$regularExpression",
    "$dbPointer",
    "$date",
    "$minKey",
    "$maxKey",
    "$undefined",
    "$unknown",
];

/// The value that `document` stands for, or itself; an error says what its wrapper should look like.
pub(super) fn unwrap(document: Document) -> Result<Bson, String> {
    let Some(wrapper) = document.keys().find(|key| key.starts_with('$') && WRAPPERS.contains(&key.as_str())) else {
        return Ok(Bson::Document(document));
    };
    let wrapper = wrapper.clone();
    value(&wrapper, &document).ok_or_else(|| format!("`{wrapper}` takes {}", shape(&wrapper)))
}

/// A key of a document, or of one in it, that Extended JSON uses: what is written of the document is read as another value,
/// or not at all.
#[must_use]
pub fn ambiguous_key(document: &Document) -> Option<&str> {
    document.iter().find_map(|(key, value)| match WRAPPERS.contains(&key.as_str()) {
        true => Some(key.as_str()),
        false => ambiguous_in(value),
    })
}

fn ambiguous_in(value: &Bson) -> Option<&str> {
    match value {
        Bson::Document(document) => ambiguous_key(document),
        Bson::Array(values) => values.iter().find_map(ambiguous_in),
        Bson::JavaScriptCodeWithScope(code) => ambiguous_key(&code.scope),
        _ => None,
    }
}

fn shape(wrapper: &str) -> &'static str {
    match wrapper {
        "$oid" => "a string of 24 hexadecimal digits, alone: {\"$oid\": \"…\"}",
        "$numberInt" => "a string with a 32 bit integer, alone",
        "$numberLong" => "a string with a 64 bit integer, alone",
        "$numberDouble" => "a string with a number, `NaN` or `Infinity`, alone",
        "$numberDecimal" => "a string with a decimal number, alone",
        "$binary" => "{\"base64\": \"…\", \"subType\": \"00\"}, alone",
        "$uuid" => "a string like 00112233-4455-6677-8899-aabbccddeeff, alone",
        "$code" | "$scope" => "{\"$code\": \"…\"}, with or without a document as \"$scope\"",
        "$timestamp" => "{\"t\": seconds, \"i\": number} of unsigned 32 bit integers, alone",
        "$regularExpression" => "{\"pattern\": \"…\", \"options\": \"…\"}, alone",
        "$dbPointer" => "{\"$ref\": \"…\", \"$id\": ObjectId}, alone",
        "$date" => "an ISO 8601 string or {\"$numberLong\": milliseconds}, alone",
        "$minKey" | "$maxKey" => "the number 1, alone",
        "$undefined" => "true, alone",
        _ => "a string, alone",
    }
}

fn value(wrapper: &str, document: &Document) -> Option<Bson> {
    match wrapper {
        "$code" | "$scope" => return code(document),
        "$binary" if document.len() == 2 => return old_binary(document),
        _ => {}
    }
    let inner = document.get(wrapper).filter(|_| document.len() == 1)?;
    match wrapper {
        "$oid" => ObjectId::parse_str(inner.as_str()?).ok().map(Bson::ObjectId),
        "$symbol" => Some(Bson::Symbol(inner.as_str()?.to_owned())),
        "$numberInt" => inner.as_str()?.parse().ok().map(Bson::Int32),
        "$numberLong" => inner.as_str()?.parse().ok().map(Bson::Int64),
        "$numberDouble" => double(inner.as_str()?).map(Bson::Double),
        "$numberDecimal" => inner.as_str()?.parse::<Decimal128>().ok().map(Bson::Decimal128),
        "$binary" => binary(inner.as_document()?),
        "$uuid" => uuid(inner.as_str()?),
        "$timestamp" => timestamp(inner.as_document()?),
        "$regularExpression" => regex(inner.as_document()?),
        "$dbPointer" => pointer(document),
        "$date" => date(inner),
        "$minKey" => one(inner).then_some(Bson::MinKey),
        "$maxKey" => one(inner).then_some(Bson::MaxKey),
        "$undefined" => (inner == &Bson::Boolean(true)).then_some(Bson::Undefined),
        _ => None,
    }
}

/// An exactly integral number as an integer.
pub(super) fn whole(value: &Bson) -> Option<i64> {
    match value {
        Bson::Int32(value) => Some(i64::from(*value)),
        Bson::Int64(value) => Some(*value),
        Bson::Double(value) if value.fract() == 0.0 && value.abs() < 9_007_199_254_740_993.0 => Some(*value as i64),
        _ => None,
    }
}

pub(super) fn double(text: &str) -> Option<f64> {
    match text {
        "Infinity" => Some(f64::INFINITY),
        "-Infinity" => Some(f64::NEG_INFINITY),
        "NaN" => Some(f64::NAN),
        _ => text.parse().ok().filter(|value: &f64| value.is_finite()),
    }
}

pub(super) fn uuid(text: &str) -> Option<Bson> {
    Uuid::parse_str(text).ok().map(|uuid| Bson::Binary(uuid.into()))
}

/// Milliseconds or ISO 8601 text as a date.
pub(super) fn date(value: &Bson) -> Option<Bson> {
    let millis = match value {
        Bson::String(text) => date::parse(text)?,
        number => whole(number)?,
    };
    Some(Bson::DateTime(DateTime::from_millis(millis)))
}

/// `{t, i}`.
pub(super) fn timestamp(inner: &Document) -> Option<Bson> {
    let part = |key| inner.get(key).and_then(whole).and_then(|value| u32::try_from(value).ok());
    let (time, increment) = (part("t")?, part("i")?);
    (inner.len() == 2).then_some(Bson::Timestamp(Timestamp { time, increment }))
}

fn one(value: &Bson) -> bool {
    whole(value) == Some(1)
}

fn code(document: &Document) -> Option<Bson> {
    let code = document.get("$code")?.as_str()?.to_owned();
    match (document.len(), document.get("$scope")) {
        (1, None) => Some(Bson::JavaScriptCode(code)),
        (2, Some(Bson::Document(scope))) => {
            Some(Bson::JavaScriptCodeWithScope(JavaScriptCodeWithScope { code, scope: scope.clone() }))
        }
        _ => None,
    }
}

fn binary(inner: &Document) -> Option<Bson> {
    let subtype = subtype(inner.get("subType")?.as_str()?)?;
    let base64 = inner.get("base64")?.as_str()?;
    (inner.len() == 2).then_some(())?;
    Binary::from_base64(base64, Some(subtype)).ok().map(Bson::Binary)
}

fn old_binary(document: &Document) -> Option<Bson> {
    let subtype = subtype(document.get("$type")?.as_str()?)?;
    Binary::from_base64(document.get("$binary")?.as_str()?, Some(subtype)).ok().map(Bson::Binary)
}

fn subtype(text: &str) -> Option<BinarySubtype> {
    let short = (1..=2).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    short.then(|| u8::from_str_radix(text, 16).ok()).flatten().map(BinarySubtype::from)
}

fn regex(inner: &Document) -> Option<Bson> {
    let (pattern, options) = (inner.get("pattern")?.as_str()?, inner.get("options")?.as_str()?);
    (inner.len() == 2).then(|| literal::any_regex(pattern, options).ok()).flatten()
}

/// The driver's type has no public constructor; its deserializer has one.
fn pointer(document: &Document) -> Option<Bson> {
    let inner = document.get_document("$dbPointer").ok().filter(|inner| inner.len() == 2)?;
    let (namespace, id) = (inner.get_str("$ref").ok()?, inner.get_object_id("$id").ok()?);
    let mut raw = Vec::new();
    raw.extend(i32::try_from(namespace.len() + 25).ok()?.to_le_bytes());
    raw.extend([0x0C, b'p', 0]);
    raw.extend(i32::try_from(namespace.len() + 1).ok()?.to_le_bytes());
    raw.extend(namespace.as_bytes());
    raw.push(0);
    raw.extend(id.bytes());
    raw.push(0);
    Document::from_reader(raw.as_slice()).ok()?.remove("p")
}
