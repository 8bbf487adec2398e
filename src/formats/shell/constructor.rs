//! The constructors of MongoDB's shell: `ISODate("…")`, `NumberLong(3)`, `BinData(0, "…")`.

use bson::spec::BinarySubtype;
use bson::{
    Binary, Bson, DateTime, Decimal128, Document, JavaScriptCodeWithScope, Timestamp, Uuid, doc, oid::ObjectId,
};

use super::{extended, literal};

/// The value of a bare word.
pub(super) fn word(name: &str) -> Option<Bson> {
    Some(match name {
        "true" => Bson::Boolean(true),
        "false" => Bson::Boolean(false),
        "null" => Bson::Null,
        "undefined" => Bson::Undefined,
        "NaN" => Bson::Double(f64::NAN),
        "Infinity" => Bson::Double(f64::INFINITY),
        "MinKey" => Bson::MinKey,
        "MaxKey" => Bson::MaxKey,
        _ => return None,
    })
}

/// The value that `name(arguments…)` makes. The error says what the constructor takes.
pub(super) fn call(name: &str, arguments: &[Bson]) -> Result<Bson, String> {
    let Some((takes, make)) = constructor(name) else {
        return Err(format!(
            "there is no constructor `{name}`; there are ISODate, ObjectId, NumberLong, NumberInt, NumberDouble, \
             NumberDecimal, Boolean, Date.now, BinData, HexData, UUID, Timestamp, RegExp, Code, Symbol, DBRef, MinKey and MaxKey"
        ));
    };
    if let ("RegExp", [Bson::String(pattern), Bson::String(options)]) = (name, arguments) {
        return literal::regex(pattern, options);
    }
    make(arguments).ok_or_else(|| {
        if let ("Date", [_, _, ..]) = (name, arguments) {
            return of_parts(arguments);
        }
        let text = arguments.first().and_then(Bson::as_str).filter(|_| name.ends_with("Date"));
        let wrong = text.and_then(super::date::wrong);
        wrong.unwrap_or_else(|| format!("`{name}` takes {takes}"))
    })
}

/// Whether there is a constructor of that name.
pub(super) fn is_known(name: &str) -> bool {
    constructor(name).is_some()
}

type Make = fn(&[Bson]) -> Option<Bson>;

/// What a constructor takes, in words, and how it makes its value.
fn constructor(name: &str) -> Option<(&'static str, Make)> {
    Some(match name {
        "ISODate" | "Date" => ("an ISO 8601 string or milliseconds since 1970", date),
        "Date.now" => ("nothing", |arguments| arguments.is_empty().then(now)),
        "Boolean" => ("a value, or nothing", boolean),
        "ObjectId" | "ObjectID" => ("a string of 24 hexadecimal digits", object_id),
        "NumberLong" | "Long" => ("a 64 bit integer, as a number or a string", long),
        "NumberInt" | "Int32" => ("a 32 bit integer, as a number or a string", int),
        "NumberDouble" | "Double" => ("a number, or a string with one", double),
        "NumberDecimal" | "Decimal128" => ("a decimal number, best as a string", decimal),
        "BinData" | "Binary" => ("a subtype from 0 to 255 and base64 text", base64),
        "HexData" => ("a subtype from 0 to 255 and hexadecimal digits", hexadecimal),
        "UUID" => ("a string like 00112233-4455-6677-8899-aabbccddeeff", uuid),
        "Timestamp" => ("seconds and a number, both unsigned 32 bit integers", timestamp),
        "RegExp" | "BSONRegExp" => ("a pattern and, perhaps, options, as strings", regex),
        "Code" => ("a string and, perhaps, a document", code),
        "Symbol" | "BSONSymbol" => ("a string", symbol),
        "DBRef" => ("a collection's name, an id and, perhaps, a database's name", reference),
        "MinKey" => ("nothing", |arguments| arguments.is_empty().then_some(Bson::MinKey)),
        "MaxKey" => ("nothing", |arguments| arguments.is_empty().then_some(Bson::MaxKey)),
        _ => return None,
    })
}

fn date(arguments: &[Bson]) -> Option<Bson> {
    match arguments {
        [] => Some(Bson::DateTime(DateTime::now())),
        [value] => extended::date(value),
        _ => None,
    }
}

/// What to write for `Date(2026, 10, 1)`, which counts months from 0, and whose time is that of the time zone that the
/// program happens to run in.
fn of_parts(arguments: &[Bson]) -> String {
    const RANGES: [(i64, i64); 7] = [(0, 9999), (0, 11), (1, 31), (0, 23), (0, 59), (0, 59), (0, 999)];
    let parts: Vec<i64> = arguments.iter().filter_map(extended::whole).collect();
    let is_date = parts.len() == arguments.len()
        && parts.len() <= RANGES.len()
        && parts.iter().zip(RANGES).all(|(part, (least, most))| (least..=most).contains(part));
    let part = |nth: usize, default: i64| parts.get(nth).copied().unwrap_or(default);
    let text = match is_date {
        true => format!(
            "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}Z",
            part(0, 0),
            part(1, 0) + 1,
            part(2, 1),
            part(3, 0),
            part(4, 0),
            part(5, 0),
            part(6, 0)
        ),
        false => String::new(),
    };
    let text = text.replace(".000Z", "Z").replace("T00:00:00Z", "");
    match is_date && super::date::wrong(&text).is_none() {
        true => format!(
            "`Date` takes a date as one string; write ISODate(\"{text}\") (JavaScript counts months from 0, and means local time)"
        ),
        false => "`Date` takes a date as one string, like ISODate(\"2026-11-01\")".to_owned(),
    }
}

/// Milliseconds since 1970.
fn now() -> Bson {
    Bson::Int64(DateTime::now().timestamp_millis())
}

/// What counts as true in JavaScript.
fn boolean(arguments: &[Bson]) -> Option<Bson> {
    let is_true = match arguments {
        [] => false,
        [value] => match value {
            Bson::Boolean(value) => *value,
            Bson::Null | Bson::Undefined => false,
            Bson::String(text) => !text.is_empty(),
            Bson::Double(number) => *number != 0.0 && !number.is_nan(),
            value => extended::whole(value) != Some(0),
        },
        _ => return None,
    };
    Some(Bson::Boolean(is_true))
}

fn object_id(arguments: &[Bson]) -> Option<Bson> {
    match arguments {
        [] => has_plain_clock().then(|| Bson::ObjectId(ObjectId::new())),
        [Bson::String(hex)] => ObjectId::parse_str(hex).ok().map(Bson::ObjectId),
        _ => None,
    }
}

fn integer(arguments: &[Bson]) -> Option<i64> {
    match arguments {
        [] => Some(0),
        [Bson::String(text)] => text.trim().parse().ok(),
        [value] => extended::whole(value),
        _ => None,
    }
}

fn long(arguments: &[Bson]) -> Option<Bson> {
    integer(arguments).map(Bson::Int64)
}

fn int(arguments: &[Bson]) -> Option<Bson> {
    integer(arguments).and_then(|value| i32::try_from(value).ok()).map(Bson::Int32)
}

fn double(arguments: &[Bson]) -> Option<Bson> {
    match arguments {
        [Bson::String(text)] => extended::double(text),
        [Bson::Double(value)] => Some(*value),
        [value] => extended::whole(value).map(|value| value as f64),
        _ => None,
    }
    .map(Bson::Double)
}

fn decimal(arguments: &[Bson]) -> Option<Bson> {
    let text = match arguments {
        [Bson::String(text)] => text.clone(),
        [Bson::Double(value)] => value.to_string(),
        [value] => extended::whole(value)?.to_string(),
        _ => return None,
    };
    text.parse::<Decimal128>().ok().map(Bson::Decimal128)
}

fn subtype(value: &Bson) -> Option<BinarySubtype> {
    extended::whole(value).and_then(|value| u8::try_from(value).ok()).map(BinarySubtype::from)
}

fn base64(arguments: &[Bson]) -> Option<Bson> {
    let [kind, Bson::String(text)] = arguments else { return None };
    Binary::from_base64(text, Some(subtype(kind)?)).ok().map(Bson::Binary)
}

fn hexadecimal(arguments: &[Bson]) -> Option<Bson> {
    let [kind, Bson::String(text)] = arguments else { return None };
    let digits = text.as_bytes();
    let valid = digits.len().is_multiple_of(2) && digits.iter().all(u8::is_ascii_hexdigit);
    let bytes = valid.then(|| (0..text.len()).step_by(2).map(|at| u8::from_str_radix(text.get(at..at + 2)?, 16).ok()));
    Some(Bson::Binary(Binary { subtype: subtype(kind)?, bytes: bytes?.collect::<Option<_>>()? }))
}

fn uuid(arguments: &[Bson]) -> Option<Bson> {
    match arguments {
        [] => Some(Bson::Binary(Uuid::new().into())),
        [Bson::String(text)] => extended::uuid(text),
        _ => None,
    }
}

fn timestamp(arguments: &[Bson]) -> Option<Bson> {
    match arguments {
        [] => Some(Bson::Timestamp(Timestamp { time: 0, increment: 0 })),
        [Bson::Document(parts)] => extended::timestamp(parts),
        [time, increment] => extended::timestamp(&doc! { "t": time.clone(), "i": increment.clone() }),
        _ => None,
    }
}

fn regex(arguments: &[Bson]) -> Option<Bson> {
    match arguments {
        [Bson::String(pattern)] => literal::regex(pattern, "").ok(),
        [Bson::String(pattern), Bson::String(options)] => literal::regex(pattern, options).ok(),
        _ => None,
    }
}

fn code(arguments: &[Bson]) -> Option<Bson> {
    match arguments {
        [Bson::String(code)] => Some(Bson::JavaScriptCode(code.clone())),
        [Bson::String(code), Bson::Document(scope)] => {
            let (code, scope) = (code.clone(), scope.clone());
            Some(Bson::JavaScriptCodeWithScope(JavaScriptCodeWithScope { code, scope }))
        }
        _ => None,
    }
}

fn symbol(arguments: &[Bson]) -> Option<Bson> {
    let [Bson::String(text)] = arguments else { return None };
    Some(Bson::Symbol(text.clone()))
}

fn reference(arguments: &[Bson]) -> Option<Bson> {
    let mut document = Document::new();
    let (collection, id, database) = match arguments {
        [Bson::String(collection), id] => (collection, id, None),
        [Bson::String(collection), id, Bson::String(database)] => (collection, id, Some(database)),
        _ => return None,
    };
    document.insert("$ref", collection.as_str());
    document.insert("$id", id.clone());
    if let Some(database) = database {
        document.insert("$db", database.as_str());
    }
    Some(Bson::Document(document))
}

/// Whether the clock is between 1970 and 2106: the driver makes no ObjectId at other times.
fn has_plain_clock() -> bool {
    u32::try_from(DateTime::now().timestamp_millis() / 1_000).is_ok()
}
