//! Keys whose bytes are in BSON order: what an index is made of.
//!
//! `encode(a) < encode(b)` exactly where `compare(a, b)` is less, and equal
//! values have equal keys, whatever their numeric types. Keys that are stored compare strings byte by byte, or by the
//! collation of their index ([`Text`]); those of a running operation by the collation in effect.

use bson::RawBsonRef;

use super::collation::{self, Collation};
use super::compare::canonical_type;
use super::decimal::Decimal;
use super::number::{Number, double_to_long};
use super::view::{Fields, View};

/// How the strings of a key compare.
#[derive(Debug, Clone, Default)]
pub(super) enum Text {
    /// By the collation in effect.
    #[default]
    InEffect,
    /// By this collation; without one, byte by byte.
    By(Option<Collation>),
}

/// Returns the key of a value, whose strings compare byte by byte.
#[must_use]
pub fn encode(value: RawBsonRef<'_>) -> Vec<u8> {
    let mut key = Vec::with_capacity(16);
    collation::during(None, || append(value.into(), &mut key));
    key
}

/// Returns the key of an owned value, whose strings compare byte by byte.
#[must_use]
pub fn encode_value(value: &bson::Bson) -> Vec<u8> {
    collation::during(None, || collated(value))
}

/// Returns the key of a value, whose strings compare by the collation in effect.
#[must_use]
pub fn collated(value: &bson::Bson) -> Vec<u8> {
    let mut key = Vec::with_capacity(16);
    append(value.into(), &mut key);
    key
}

impl Text {
    /// Appends the key of a value.
    pub(super) fn append(&self, value: View<'_>, key: &mut Vec<u8>) {
        match self {
            Self::InEffect => append(value, key),
            Self::By(collation) => collation::during(collation.as_ref(), || append(value, key)),
        }
    }
}

/// Appends the key of a value by the collation in effect; a sequence of keys is ordered like the sequence of values.
pub(super) fn append(value: View<'_>, key: &mut Vec<u8>) {
    key.push(canonical_type(value));
    match value {
        View::MinKey | View::MaxKey | View::Undefined | View::Null => {}
        View::Number(number) => number_key(number, key),
        View::String(text) | View::Symbol(text) => match collation::is_in_effect() {
            false => text_key(text.as_bytes(), key),
            true => text_key(&collation::sort_key(text).unwrap_or_default(), key),
        },
        View::Document(fields) => document_key(fields, key),
        View::Array(items) => {
            for item in items.iter() {
                append(item, key);
            }
            key.push(0);
        }
        View::Binary(subtype, bytes) => {
            key.extend_from_slice(&(bytes.len() as u64).to_be_bytes());
            key.push(subtype);
            key.extend_from_slice(bytes);
        }
        View::ObjectId(id) => key.extend_from_slice(&id.bytes()),
        View::Bool(value) => key.push(value.into()),
        View::Date(millis) => key.extend_from_slice(&ordered(millis)),
        View::Timestamp(time, increment) => {
            key.extend_from_slice(&time.to_be_bytes());
            key.extend_from_slice(&increment.to_be_bytes());
        }
        View::Regex(pattern, options) => {
            text_key(pattern.as_bytes(), key);
            text_key(options.as_bytes(), key);
        }
        View::DbPointer(pointer) => text_key(pointer.text().as_bytes(), key),
        View::Code(code) => text_key(code.as_bytes(), key),
        View::CodeWithScope(code, scope) => {
            text_key(code.as_bytes(), key);
            document_key(scope, key);
        }
    }
}

/// Type, name, value of every field; a zero ends it, and no type's place is zero.
fn document_key(fields: Fields<'_>, key: &mut Vec<u8>) {
    for (name, value) in fields.iter() {
        key.push(canonical_type(value));
        text_key(name.as_bytes(), key);
        append(value, key);
    }
    key.push(0);
}

/// Returns the bytes, a zero as `00 ff`, ended by `00 00`... written so that a prefix comes first.
fn text_key(bytes: &[u8], key: &mut Vec<u8>) {
    for byte in bytes {
        key.push(*byte);
        if *byte == 0 {
            key.push(0xff);
        }
    }
    key.extend_from_slice(&[0, 0]);
}

/// Two's complement turned into the order of bytes.
fn ordered(value: i64) -> [u8; 8] {
    (value.cast_unsigned() ^ 1 << 63).to_be_bytes()
}

const NAN: u8 = 1;
const NEGATIVE_INFINITY: u8 = 2;
const NEGATIVE: u8 = 3;
const ZERO: u8 = 4;
const POSITIVE: u8 = 5;
const INFINITY: u8 = 6;

/// Sign, decimal exponent, digits in pairs: the same for equal numbers of all types.
fn number_key(number: Number, key: &mut Vec<u8>) {
    let (negative, coefficient, exponent) = match number {
        Number::Int(value) => (value < 0, u128::from(value.unsigned_abs()), 0),
        Number::Long(value) => (value < 0, u128::from(value.unsigned_abs()), 0),
        Number::Double(value) => match double_to_long(value).filter(|_| value.fract() == 0.0) {
            Some(whole) => (whole < 0, u128::from(whole.unsigned_abs()), 0),
            None => match Decimal::from_double(value) {
                Decimal::Finite { negative, coefficient, exponent } => (negative, coefficient, exponent),
                other => return special_key(other, key),
            },
        },
        Number::Decimal(Decimal::Finite { negative, coefficient, exponent }) => (negative, coefficient, exponent),
        Number::Decimal(other) => return special_key(other, key),
    };
    let Some((_, exponent, digits)) = Decimal::scientific(negative, coefficient, exponent) else {
        return key.push(ZERO);
    };
    key.push(if negative { NEGATIVE } else { POSITIVE });
    let start = key.len();
    let biased = u16::try_from(exponent + 8000).unwrap_or(0);
    key.extend_from_slice(&biased.to_be_bytes());
    let pairs = pairs(digits);
    let last = pairs.iter().rposition(|pair| *pair != 0).map_or(0, |last| last + 1);
    key.extend(pairs.iter().take(last).map(|pair| pair + 1));
    key.push(0);
    if negative {
        for byte in key.iter_mut().skip(start) {
            *byte = !*byte;
        }
    }
}

/// 34 digits in pairs.
fn pairs(digits: u128) -> [u8; 17] {
    const LOW: u128 = 10u128.pow(16);
    let mut pairs = [0; 17];
    let halves = [digits / LOW, digits % LOW].map(|half| u64::try_from(half).unwrap_or(0));
    let (high, low) = pairs.split_at_mut(9);
    for (pairs, mut rest) in [high, low].into_iter().zip(halves) {
        for pair in pairs.iter_mut().rev() {
            *pair = (rest % 100) as u8;
            rest /= 100;
        }
    }
    pairs
}

fn special_key(decimal: Decimal, key: &mut Vec<u8>) {
    key.push(match decimal {
        Decimal::NaN => NAN,
        Decimal::Infinite { negative: true } => NEGATIVE_INFINITY,
        Decimal::Infinite { negative: false } => INFINITY,
        Decimal::Finite { .. } => ZERO,
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{Bson, bson};

    #[test]
    fn equal_numbers_have_equal_keys() {
        let decimal = Bson::Decimal128("1.00".parse().unwrap());
        for value in [Bson::Int64(1), Bson::Double(1.0), decimal] {
            assert_eq!(encode_value(&Bson::Int32(1)), encode_value(&value));
        }
        assert_eq!(encode_value(&bson!(-0.0)), encode_value(&bson!(0)));
    }

    #[test]
    fn prefixes_come_first() {
        for (less, more) in [
            (bson!("a"), bson!("ab")),
            (bson!("a"), bson!("a\0")),
            (bson!([1]), bson!([1, 2])),
            (bson!({}), bson!({"a": 1})),
            (bson!([[], 1]), bson!([[1], 0])),
            (bson!(-2), bson!(-1.5)),
            (bson!(0.1), bson!(1)),
        ] {
            assert!(encode_value(&less) < encode_value(&more), "{less} {more}");
        }
    }
}
