//! Sums and products across the numeric types: ints widen to longs, then to doubles; decimals win.

use super::error::{QueryError, Result};
use super::number::Number;

/// What an overflowing sum or product of longs does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Overflow {
    /// An error, as in updates.
    Refuse,
    /// A double, as in expressions.
    Double,
}

/// Returns the sum.
pub(super) fn add(a: Number, b: Number, overflow: Overflow) -> Result<Number> {
    integers_or(
        a,
        b,
        overflow,
        i64::checked_add,
        |a, b| a + b,
        |a, b| Number::Decimal(a.to_decimal().plus(b.to_decimal())),
    )
}

/// Returns the difference.
pub(super) fn subtract(a: Number, b: Number, overflow: Overflow) -> Result<Number> {
    integers_or(
        a,
        b,
        overflow,
        i64::checked_sub,
        |a, b| a - b,
        |a, b| Number::Decimal(a.to_decimal().minus(b.to_decimal())),
    )
}

/// Returns the product.
pub(super) fn multiply(a: Number, b: Number, overflow: Overflow) -> Result<Number> {
    integers_or(
        a,
        b,
        overflow,
        i64::checked_mul,
        |a, b| a * b,
        |a, b| Number::Decimal(a.to_decimal().times(b.to_decimal())),
    )
}

fn integers_or(
    a: Number,
    b: Number,
    overflow: Overflow,
    integers: fn(i64, i64) -> Option<i64>,
    doubles: fn(f64, f64) -> f64,
    decimals: fn(Number, Number) -> Number,
) -> Result<Number> {
    match (a, b) {
        (Number::Decimal(_), _) | (_, Number::Decimal(_)) => Ok(decimals(a, b)),
        (Number::Double(_), _) | (_, Number::Double(_)) => Ok(Number::Double(doubles(a.to_double(), b.to_double()))),
        _ => match integers(a.to_long(), b.to_long()) {
            Some(value) => Ok(narrowed(a, b, value)),
            None if overflow == Overflow::Double => Ok(Number::Double(doubles(a.to_double(), b.to_double()))),
            None => Err(QueryError::bad_value("the result does not fit a 64-bit integer")),
        },
    }
}

/// Returns an int where both operands were and the value fits.
fn narrowed(a: Number, b: Number, value: i64) -> Number {
    match (a, b, i32::try_from(value)) {
        (Number::Int(_), Number::Int(_), Ok(value)) => Number::Int(value),
        _ => Number::Long(value),
    }
}
