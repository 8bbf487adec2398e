//! Conversion between types.

use bson::oid::ObjectId;
use bson::{Bson, DateTime, Decimal128};

use super::date::{object_id_millis, parse_iso};
use super::operator::{Arguments, Named, Operator, at, is_null, type_name};
use super::value::Value;
use crate::calendar::{Civil, iso_text};
use crate::query::decimal::Decimal;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::view::{TYPE_NAMES, View};

/// MongoDB's code of a failed conversion.
const FAILURE: i32 = 241;

pub(super) const OPERATORS: [Operator; 8] = [
    Operator { name: "$toInt", arity: (1, 1), call: |v| to(v, Target::Int) },
    Operator { name: "$toLong", arity: (1, 1), call: |v| to(v, Target::Long) },
    Operator { name: "$toDouble", arity: (1, 1), call: |v| to(v, Target::Double) },
    Operator { name: "$toDecimal", arity: (1, 1), call: |v| to(v, Target::Decimal) },
    Operator { name: "$toString", arity: (1, 1), call: |v| to(v, Target::String) },
    Operator { name: "$toBool", arity: (1, 1), call: |v| to(v, Target::Bool) },
    Operator { name: "$toDate", arity: (1, 1), call: |v| to(v, Target::Date) },
    Operator { name: "$toObjectId", arity: (1, 1), call: |v| to(v, Target::ObjectId) },
];

pub(super) const NAMED: [Named; 1] = [Named {
    name: "$convert",
    fields: &[("input", true), ("to", true), ("onError", false), ("onNull", false)],
    bare: false,
    call: convert,
}];

/// Types that something can be converted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    Int,
    Long,
    Double,
    Decimal,
    String,
    Bool,
    Date,
    ObjectId,
    /// A type that nothing can be converted to.
    Other,
}

fn to(values: &[Value], target: Target) -> Result<Value> {
    match at(values, 0) {
        value if is_null(value) => Ok(Some(Bson::Null)),
        value => converted(value, target).map(Some),
    }
}

fn convert(arguments: &Arguments) -> Result<Value> {
    let target = match arguments.get(1) {
        value if is_null(value) => None,
        value => Some(target(value)?),
    };
    let value = arguments.get(0);
    if is_null(value) && arguments.given(3) {
        return Ok(arguments.values.get(3).cloned().flatten().flatten());
    }
    let Some(target) = target else { return Ok(Some(Bson::Null)) };
    if is_null(value) {
        return Ok(Some(Bson::Null));
    }
    match converted(value, target) {
        Err(_) if arguments.given(2) => Ok(arguments.values.get(2).cloned().flatten().flatten()),
        other => other.map(Some),
    }
}

fn target(value: &Bson) -> Result<Target> {
    let code = match value {
        Bson::String(name) => TYPE_NAMES.iter().find(|(known, _)| known == name).map(|(_, code)| *code),
        value => match Number::of(value) {
            Some(number) => match number.integral_32() {
                // No value converts to these types.
                Some(0) => return Ok(Target::Other),
                Some(code) => TYPE_NAMES.iter().find(|(_, known)| *known == code).map(|(_, code)| *code),
                None => return Err(QueryError::failed_to_parse("$convert's 'to' is not an integral type code")),
            },
            None => return Err(QueryError::failed_to_parse("$convert's 'to' must be a string or number")),
        },
    };
    Ok(match code {
        Some(16) => Target::Int,
        Some(18) => Target::Long,
        Some(1) => Target::Double,
        Some(19) => Target::Decimal,
        Some(2) => Target::String,
        Some(8) => Target::Bool,
        Some(9) => Target::Date,
        Some(7) => Target::ObjectId,
        Some(_) => Target::Other,
        None => return Err(QueryError::bad_value(format!("unknown type name: {value}"))),
    })
}

fn failure(value: &Bson, why: &str) -> QueryError {
    QueryError::invalid(FAILURE, format!("cannot convert {} {value}: {why}", type_name(value)))
}

fn converted(value: &Bson, target: Target) -> Result<Bson> {
    let unsupported = || failure(value, "no such conversion");
    match target {
        Target::Bool => Ok(Bson::Boolean(View::from(value).truthy())),
        Target::String => match value {
            Bson::Boolean(_)
            | Bson::Double(_)
            | Bson::Int32(_)
            | Bson::Int64(_)
            | Bson::Decimal128(_)
            | Bson::String(_)
            | Bson::ObjectId(_) => text_of(value).map(Bson::String).ok_or_else(unsupported),
            Bson::DateTime(moment) => {
                let year = Civil::from_millis(moment.timestamp_millis()).year;
                if !(0..=9999).contains(&year) {
                    return Err(QueryError::invalid(18_537, format!("a date of the year {year} has no text")));
                }
                text_of(value).map(Bson::String).ok_or_else(unsupported)
            }
            _ => Err(unsupported()),
        },
        Target::ObjectId => match value {
            Bson::ObjectId(id) => Ok(Bson::ObjectId(*id)),
            Bson::String(text) => {
                ObjectId::parse_str(text).map(Bson::ObjectId).map_err(|_| failure(value, "not 24 hex digits"))
            }
            _ => Err(unsupported()),
        },
        Target::Date => to_date(value).map(|millis| Bson::DateTime(DateTime::from_millis(millis))),
        Target::Int | Target::Long => to_integer(value, target),
        Target::Double => to_double(value).map(Bson::Double),
        Target::Decimal => to_decimal(value).map(|decimal| Bson::Decimal128(decimal.into())),
        Target::Other => Err(unsupported()),
    }
}

fn to_date(value: &Bson) -> Result<i64> {
    match value {
        Bson::DateTime(moment) => Ok(moment.timestamp_millis()),
        Bson::Timestamp(timestamp) => Ok(i64::from(timestamp.time) * 1000),
        Bson::ObjectId(id) => Ok(object_id_millis(id)),
        Bson::String(text) => parse_iso(text).ok_or_else(|| failure(value, "not a date")),
        Bson::Int64(millis) => Ok(*millis),
        Bson::Double(_) | Bson::Decimal128(_) => match to_integer(value, Target::Long)? {
            Bson::Int64(millis) => Ok(millis),
            _ => Err(failure(value, "out of range")),
        },
        _ => Err(failure(value, "no such conversion")),
    }
}

fn to_integer(value: &Bson, target: Target) -> Result<Bson> {
    let integer: i128 = match value {
        Bson::Boolean(value) => i128::from(*value),
        Bson::Int32(value) => i128::from(*value),
        Bson::Int64(value) => i128::from(*value),
        Bson::Double(double) if !double.is_finite() => return Err(failure(value, "not a finite number")),
        #[expect(clippy::cast_possible_truncation, reason = "saturates, and the range is checked below")]
        Bson::Double(double) => *double as i128,
        Bson::Decimal128(decimal) => {
            let decimal = Decimal::from(*decimal);
            match decimal.to_i128() {
                Some(integer) => integer,
                None if decimal.is_zero() => 0,
                None => return Err(failure(value, "out of range")),
            }
        }
        Bson::DateTime(moment) if target == Target::Long => i128::from(moment.timestamp_millis()),
        Bson::String(text) => i128::from(integer_of(text).ok_or_else(|| failure(value, "not an integer"))?),
        _ => return Err(failure(value, "no such conversion")),
    };
    let converted = match target {
        Target::Int => i32::try_from(integer).ok().map(Bson::Int32),
        _ => i64::try_from(integer).ok().map(Bson::Int64),
    };
    converted.ok_or_else(|| failure(value, "out of range"))
}

/// Decimal digits with a sign, no blanks.
fn integer_of(text: &str) -> Option<i64> {
    text.parse().ok()
}

fn to_double(value: &Bson) -> Result<f64> {
    match value {
        Bson::Boolean(value) => Ok(f64::from(u8::from(*value))),
        #[expect(clippy::cast_precision_loss, reason = "the nearest double is meant")]
        Bson::DateTime(moment) => Ok(moment.timestamp_millis() as f64),
        Bson::String(text) => {
            let double = parsed(text, |text| text.parse::<f64>().ok().or_else(|| hexadecimal(text)))
                .filter(|_| !text.starts_with("0x"))
                .ok_or_else(|| failure(value, "not a number"))?;
            let named_infinite = text.trim_start_matches(['-', '+']).starts_with(['i', 'I']);
            let is_nothing =
                text.split(['e', 'E']).next().is_some_and(|digits| !digits.contains(|c| ('1'..='9').contains(&c)));
            let is_lost = double.is_infinite() && !named_infinite || double == 0.0 && !is_nothing;
            if is_lost { Err(failure(value, "out of range")) } else { Ok(double) }
        }
        Bson::Decimal128(decimal) => {
            let decimal = Decimal::from(*decimal);
            let double = decimal.to_double();
            let lost = double.is_infinite() && !decimal.is_infinite();
            if lost { Err(failure(value, "out of range")) } else { Ok(double) }
        }
        value => Number::of(value).map(Number::to_double).ok_or_else(|| failure(value, "no such conversion")),
    }
}

fn to_decimal(value: &Bson) -> Result<Decimal> {
    match value {
        Bson::Boolean(value) => Ok(Decimal::from_integer(i128::from(*value))),
        Bson::DateTime(moment) => Ok(Decimal::from_integer(moment.timestamp_millis().into())),
        Bson::String(text) => {
            let decimal = parsed(text, Decimal::parse).ok_or_else(|| failure(value, "not a number"))?;
            let is_lost = decimal.is_infinite() && !text.trim_start_matches(['-', '+']).starts_with(['i', 'I']);
            if is_lost { Err(failure(value, "out of range")) } else { Ok(decimal) }
        }
        value => Number::of(value).map(Number::to_decimal).ok_or_else(|| failure(value, "no such conversion")),
    }
}

/// Reads a number that has no blanks around it and is not hexadecimal.
fn parsed<T>(text: &str, parse: impl Fn(&str) -> Option<T>) -> Option<T> {
    let plain = text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"+-.".contains(&byte));
    if plain && !text.is_empty() { parse(text) } else { None }
}

/// Returns the text of a simple value.
pub(super) fn text_of(value: &Bson) -> Option<String> {
    Some(match value {
        Bson::String(text) | Bson::Symbol(text) | Bson::JavaScriptCode(text) => text.clone(),
        Bson::Boolean(value) => value.to_string(),
        Bson::Int32(value) => value.to_string(),
        Bson::Int64(value) => value.to_string(),
        Bson::Double(value) => double_text(*value),
        Bson::Decimal128(value) => decimal_text(*value),
        Bson::ObjectId(id) => id.to_hex(),
        Bson::DateTime(moment) => iso_text(moment.timestamp_millis()),
        Bson::Timestamp(timestamp) => {
            format!("Timestamp({}, {})", timestamp.time, timestamp.increment)
        }
        _ => return None,
    })
}

fn decimal_text(value: Decimal128) -> String {
    value.to_string()
}

/// Returns the fewest digits that read back as the same double, with an exponent where it is long.
pub(super) fn double_text(value: f64) -> String {
    if value.is_nan() {
        return "NaN".to_owned();
    }
    if value.is_infinite() {
        return if value < 0.0 { "-Infinity" } else { "Infinity" }.to_owned();
    }
    let scientific = format!("{value:e}");
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if (-4..16).contains(&exponent) { format!("{value}") } else { with_exponent(mantissa, exponent) }
}

fn with_exponent(mantissa: &str, exponent: i32) -> String {
    format!("{mantissa}e{}{:02}", if exponent < 0 { '-' } else { '+' }, exponent.abs())
}

/// Returns a double as C's `%g` writes it: what operators on strings take a double for.
pub(super) fn short_double_text(value: f64) -> String {
    if value.is_nan() {
        return "nan".to_owned();
    }
    if value.is_infinite() {
        return if value < 0.0 { "-inf" } else { "inf" }.to_owned();
    }
    let scientific = format!("{value:.5e}");
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let trimmed = |text: &str| {
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text.to_owned() }
    };
    if (-4..6).contains(&exponent) {
        let places = usize::try_from(5 - exponent).unwrap_or(0);
        return trimmed(&format!("{value:.places$}"));
    }
    with_exponent(&trimmed(mantissa), exponent)
}

/// Reads C's hexadecimal doubles, like `0x1.8p1`.
fn hexadecimal(text: &str) -> Option<f64> {
    let (negative, rest) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let rest = rest.strip_prefix("0x").or_else(|| rest.strip_prefix("0X"))?;
    let (digits, power) = rest.split_once(['p', 'P']).unwrap_or((rest, "0"));
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    if whole.is_empty() && fraction.is_empty() {
        return None;
    }
    let mut value = 0.0;
    for digit in whole.chars().chain(fraction.chars()) {
        value = value * 16.0 + f64::from(digit.to_digit(16)?);
    }
    let shift = power.parse::<i32>().ok()?.saturating_sub(i32::try_from(fraction.len()).ok()?.saturating_mul(4));
    let value = value * 2f64.powi(shift);
    Some(if negative { -value } else { value })
}
