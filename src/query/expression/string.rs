//! Strings, in bytes and in code points.

use bson::Bson;

use super::convert::{short_double_text, text_of};
use super::operator::{ANY, Arguments, Named, Operator, any_null, at, is_null, type_name, wrong_type};
use super::value::Value;
use crate::calendar::Civil;
use crate::query::decimal::Rounding;
use crate::query::error::{QueryError, Result};
use crate::query::limit::{ALLOCATION, check_elements, check_string};
use crate::query::number::{Number, double_to_long};

pub(super) const OPERATORS: [Operator; 12] = [
    Operator { name: "$concat", arity: (0, ANY), call: concatenated },
    Operator { name: "$toLower", arity: (1, 1), call: |v| cased("$toLower", v, |text| text.to_ascii_lowercase()) },
    Operator { name: "$toUpper", arity: (1, 1), call: |v| cased("$toUpper", v, |text| text.to_ascii_uppercase()) },
    Operator { name: "$strcasecmp", arity: (2, 2), call: compare_ignoring_case },
    Operator { name: "$strLenBytes", arity: (1, 1), call: |v| length("$strLenBytes", 34_473, v, str::len) },
    Operator {
        name: "$strLenCP",
        arity: (1, 1),
        call: |v| length("$strLenCP", 34_471, v, |text| text.chars().count()),
    },
    Operator { name: "$split", arity: (2, 2), call: split },
    Operator { name: "$substr", arity: (3, 3), call: |v| bytes_of("$substrBytes", v) },
    Operator { name: "$substrBytes", arity: (3, 3), call: |v| bytes_of("$substrBytes", v) },
    Operator { name: "$substrCP", arity: (3, 3), call: code_points_of },
    Operator { name: "$indexOfBytes", arity: (2, 4), call: |v| index_of("$indexOfBytes", v, Unit::Byte) },
    Operator { name: "$indexOfCP", arity: (2, 4), call: |v| index_of("$indexOfCP", v, Unit::CodePoint) },
];

pub(super) const NAMED: [Named; 6] = [
    Named { name: "$trim", fields: &[("input", true), ("chars", false)], bare: false, call: |a| trim(a, true, true) },
    Named { name: "$ltrim", fields: &[("input", true), ("chars", false)], bare: false, call: |a| trim(a, true, false) },
    Named { name: "$rtrim", fields: &[("input", true), ("chars", false)], bare: false, call: |a| trim(a, false, true) },
    Named {
        name: "$replaceOne",
        fields: &[("input", true), ("find", true), ("replacement", true)],
        bare: false,
        call: |a| replace(a, 1),
    },
    Named {
        name: "$replaceAll",
        fields: &[("input", true), ("find", true), ("replacement", true)],
        bare: false,
        call: |a| replace(a, usize::MAX),
    },
    Named { name: "$binarySize", fields: &[("value", true)], bare: true, call: binary_size },
];

fn binary_size(arguments: &Arguments) -> Result<Value> {
    let length = match arguments.get(0) {
        value if is_null(value) => return Ok(Some(Bson::Null)),
        Bson::String(text) => text.len(),
        Bson::Binary(binary) => binary.bytes.len(),
        other => return Err(wrong_type(51_276, "$binarySize", "a string or binary data", other)),
    };
    Ok(Some(Bson::Int32(i32::try_from(length).unwrap_or(i32::MAX))))
}

fn concatenated(values: &[Value]) -> Result<Value> {
    let mut text = String::new();
    let mut null = false;
    for index in 0..values.len() {
        match at(values, index) {
            value if is_null(value) => null = true,
            Bson::String(part) => {
                check_string(text.len() + part.len())?;
                text.push_str(part);
            }
            other => return Err(wrong_type(16_702, "$concat", "strings", other)),
        }
        if null {
            return Ok(Some(Bson::Null));
        }
    }
    Ok(Some(Bson::String(text)))
}

/// Returns the text that `$toUpper` and its kin take a value for; null is empty.
fn coerced(operator: &str, value: &Bson) -> Result<String> {
    match value {
        value if is_null(value) => Ok(String::new()),
        Bson::Double(value) => Ok(short_double_text(*value)),
        Bson::Timestamp(timestamp) => Ok(timestamp_text(*timestamp)),
        Bson::String(_)
        | Bson::Int32(_)
        | Bson::Int64(_)
        | Bson::Decimal128(_)
        | Bson::DateTime(_)
        | Bson::Symbol(_)
        | Bson::JavaScriptCode(_) => text_of(value).ok_or_else(|| wrong_type(16_007, operator, "a string", value)),
        other => Err(wrong_type(16_007, operator, "a string", other)),
    }
}

/// Returns a timestamp as `Jan  1 00:00:01:1`.
fn timestamp_text(timestamp: bson::Timestamp) -> String {
    const MONTHS: [&str; 12] = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];
    let civil = Civil::from_millis(i64::from(timestamp.time) * 1000);
    let month = usize::try_from(civil.month - 1).ok().and_then(|month| MONTHS.get(month)).unwrap_or(&"");
    format!(
        "{month} {:>2} {:02}:{:02}:{:02}:{}",
        civil.day, civil.hour, civil.minute, civil.second, timestamp.increment
    )
}

fn cased(operator: &str, values: &[Value], change: fn(&str) -> String) -> Result<Value> {
    Ok(Some(Bson::String(change(&coerced(operator, at(values, 0))?))))
}

fn compare_ignoring_case(values: &[Value]) -> Result<Value> {
    let upper = |index| coerced("$strcasecmp", at(values, index)).map(|text: String| text.to_ascii_uppercase());
    Ok(Some(Bson::Int32(upper(0)?.as_bytes().cmp(upper(1)?.as_bytes()) as i32)))
}

fn length(operator: &str, code: i32, values: &[Value], measure: fn(&str) -> usize) -> Result<Value> {
    match at(values, 0) {
        Bson::String(text) => Ok(Some(Bson::Int32(i32::try_from(measure(text)).unwrap_or(i32::MAX)))),
        other => Err(wrong_type(code, operator, "a string", other)),
    }
}

fn split(values: &[Value]) -> Result<Value> {
    let (text, separator) = (at(values, 0), at(values, 1));
    if any_null(values) {
        return Ok(Some(Bson::Null));
    }
    let text = match text {
        value if is_null(value) => None,
        Bson::String(text) => Some(text),
        other => return Err(wrong_type(40_085, "$split", "a string as first argument", other)),
    };
    let separator = match separator {
        value if is_null(value) => None,
        Bson::String(separator) => Some(separator),
        other => return Err(wrong_type(40_086, "$split", "a string as second argument", other)),
    };
    let (Some(text), Some(separator)) = (text, separator) else { return Ok(Some(Bson::Null)) };
    if separator.is_empty() {
        return Err(QueryError::invalid(40_087, "$split requires a non-empty separator"));
    }
    check_elements(text.matches(separator.as_str()).count(), ALLOCATION)?;
    Ok(Some(Bson::Array(text.split(separator.as_str()).map(Bson::from).collect())))
}

/// Returns a number cut to an integer.
fn integer(code: i32, operator: &str, value: &Bson) -> Result<i64> {
    let number = Number::of(value).ok_or_else(|| {
        QueryError::invalid(code, format!("{operator}: bounds must be numeric (is BSON type {})", type_name(value)))
    })?;
    match number {
        Number::Double(double) => double_to_long(double)
            .ok_or_else(|| QueryError::invalid(31_109, format!("can't coerce out of range value {double} to long"))),
        // Decimals are rounded, and the least long stands for those out of range.
        Number::Decimal(decimal) => {
            let whole = decimal.round_to(0, Rounding::HalfEven).to_i128();
            Ok(whole.and_then(|whole| i64::try_from(whole).ok()).unwrap_or(i64::MIN))
        }
        other => Ok(other.to_long()),
    }
}

fn bytes_of(operator: &str, values: &[Value]) -> Result<Value> {
    let text = coerced(operator, at(values, 0))?;
    let start = integer(16_034, operator, at(values, 1))?;
    let count = integer(16_035, operator, at(values, 2))?;
    let Ok(start) = usize::try_from(start) else {
        return Err(QueryError::invalid(50_752, format!("{operator}: starting index must be non-negative")));
    };
    let count = usize::try_from(count).unwrap_or(usize::MAX);
    let end = start.saturating_add(count).min(text.len());
    if start >= text.len() {
        return Ok(Some(Bson::String(String::new())));
    }
    match (text.is_char_boundary(start), text.get(start..end)) {
        (true, Some(part)) => Ok(Some(Bson::String(part.to_owned()))),
        (false, _) => Err(QueryError::invalid(
            28_656,
            format!("{operator}: invalid range, starting index is a UTF-8 continuation byte"),
        )),
        _ => Err(QueryError::invalid(
            28_657,
            format!("{operator}: invalid range, ending index is in the middle of a UTF-8 character"),
        )),
    }
}

fn code_points_of(values: &[Value]) -> Result<Value> {
    let text = coerced("$substrCP", at(values, 0))?;
    let bound = |index: usize, what: &str, [wrong, fraction, negative]: [i32; 3]| -> Result<usize> {
        let value = at(values, index);
        let number = Number::of(value).ok_or_else(|| wrong_type(wrong, "$substrCP", "numeric bounds", value))?;
        let number = number.integral_32().ok_or_else(|| {
            QueryError::invalid(fraction, format!("$substrCP: {what} cannot be represented as a 32-bit integral value"))
        })?;
        usize::try_from(number)
            .map_err(|_| QueryError::invalid(negative, format!("$substrCP: {what} must be a nonnegative integer")))
    };
    let start = bound(1, "starting index", [34_450, 34_451, 34_455])?;
    let count = bound(2, "length", [34_452, 34_453, 34_454])?;
    Ok(Some(Bson::String(text.chars().skip(start).take(count).collect())))
}

/// What positions count.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Unit {
    Byte,
    CodePoint,
}

fn index_of(operator: &str, values: &[Value], unit: Unit) -> Result<Value> {
    let codes = if unit == Unit::Byte { (40_091, 40_092) } else { (40_093, 40_094) };
    let text = match at(values, 0) {
        value if is_null(value) => return Ok(Some(Bson::Null)),
        Bson::String(text) => text,
        other => return Err(wrong_type(codes.0, operator, "a string as first argument", other)),
    };
    let Bson::String(wanted) = at(values, 1) else {
        return Err(wrong_type(codes.1, operator, "a string as second argument", at(values, 1)));
    };
    let length = if unit == Unit::Byte { text.len() } else { text.chars().count() };
    let bound = |index: usize, default: usize| -> Result<usize> {
        if values.get(index).is_none() {
            return Ok(default);
        }
        let bound = Number::of(at(values, index))
            .and_then(Number::integral_32)
            .ok_or_else(|| QueryError::invalid(40_096, format!("{operator} needs 32-bit integers as bounds")))?;
        usize::try_from(bound).map_err(|_| QueryError::invalid(40_097, format!("{operator} needs a nonnegative bound")))
    };
    let (start, end) = (bound(2, 0)?, bound(3, length)?.min(length));
    if start > length || start > end {
        return Ok(Some(Bson::Int32(-1)));
    }
    let found = match unit {
        Unit::Byte => find_bytes(text.as_bytes(), wanted.as_bytes(), start, end),
        Unit::CodePoint => {
            let offset = |index: usize| text.char_indices().nth(index).map_or(text.len(), |(offset, _)| offset);
            let (start, end) = (offset(start), offset(end));
            // A match must begin before the end; it may reach beyond.
            let found = text.get(start..).and_then(|part| part.find(wanted.as_str())).map(|at| start + at);
            let found = found.filter(|at| *at < end || text.is_empty());
            found.map(|at| text.get(..at).map_or(0, |before| before.chars().count()))
        }
    };
    Ok(Some(Bson::Int32(found.and_then(|index| i32::try_from(index).ok()).unwrap_or(-1))))
}

fn find_bytes(text: &[u8], wanted: &[u8], start: usize, end: usize) -> Option<usize> {
    let part = text.get(start..end)?;
    if wanted.is_empty() {
        return Some(start);
    }
    part.windows(wanted.len()).position(|window| window == wanted).map(|at| start + at)
}

/// What `$trim` removes by default: white space and NUL.
const BLANKS: [char; 20] = [
    '\0', ' ', '\t', '\n', '\u{b}', '\u{c}', '\r', '\u{a0}', '\u{1680}', '\u{2000}', '\u{2001}', '\u{2002}',
    '\u{2003}', '\u{2004}', '\u{2005}', '\u{2006}', '\u{2007}', '\u{2008}', '\u{2009}', '\u{200a}',
];

fn trim(arguments: &Arguments, left: bool, right: bool) -> Result<Value> {
    let text = match arguments.get(0) {
        value if is_null(value) => None,
        Bson::String(text) => Some(text.as_str()),
        other => return Err(wrong_type(50_699, arguments.operator, "a string as input", other)),
    };
    if text.is_none() {
        return Ok(Some(Bson::Null));
    }
    let chars: Vec<char> = match arguments.get(1) {
        _ if !arguments.given(1) => BLANKS.to_vec(),
        value if is_null(value) => return Ok(Some(Bson::Null)),
        Bson::String(chars) => chars.chars().collect(),
        other => return Err(wrong_type(50_700, arguments.operator, "a string of characters", other)),
    };
    let Some(mut text) = text else { return Ok(Some(Bson::Null)) };
    if left {
        text = text.trim_start_matches(chars.as_slice());
    }
    if right {
        text = text.trim_end_matches(chars.as_slice());
    }
    Ok(Some(Bson::String(text.to_owned())))
}

fn replace(arguments: &Arguments, count: usize) -> Result<Value> {
    let mut texts = Vec::with_capacity(3);
    let mut null = false;
    for (index, code) in [(0, 51_746), (1, 51_745), (2, 51_744)] {
        match arguments.get(index) {
            value if is_null(value) => null = true,
            Bson::String(text) => texts.push(text),
            other => return Err(wrong_type(code, arguments.operator, "strings", other)),
        }
    }
    let ([input, find, replacement], false) = (texts.as_slice(), null) else { return Ok(Some(Bson::Null)) };
    let found = input.matches(find.as_str()).take(count).count();
    check_string((input.len() - found * find.len()).saturating_add(found.saturating_mul(replacement.len())))?;
    Ok(Some(Bson::String(input.replacen(find.as_str(), replacement, count))))
}
