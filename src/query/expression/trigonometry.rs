//! Trigonometry, in radians.

use std::f64::consts::LN_2;

use bson::Bson;

use super::operator::{Operator, at, is_null, wrong_type};
use super::value::Value;
use crate::query::decimal::Decimal;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;

/// An operator of one argument whose domain is all numbers, or an interval.
macro_rules! function {
    ($name:literal, $double:expr, $decimal:expr, $low:expr, $high:expr) => {
        Operator { name: $name, arity: (1, 1), call: |values| apply($name, values, $double, $decimal, ($low, $high)) }
    };
}

const ALL: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
const FINITE: (f64, f64) = (f64::MIN, f64::MAX);

pub(super) const OPERATORS: [Operator; 15] = [
    function!("$sin", f64::sin, Decimal::sine, FINITE.0, FINITE.1),
    function!("$cos", f64::cos, Decimal::cosine, FINITE.0, FINITE.1),
    function!("$tan", f64::tan, Decimal::tangent, FINITE.0, FINITE.1),
    function!("$asin", f64::asin, Decimal::arc_sine, -1.0, 1.0),
    function!("$acos", f64::acos, Decimal::arc_cosine, -1.0, 1.0),
    function!("$atan", f64::atan, Decimal::arc_tangent, ALL.0, ALL.1),
    function!("$sinh", f64::sinh, Decimal::hyperbolic_sine, ALL.0, ALL.1),
    function!("$cosh", f64::cosh, Decimal::hyperbolic_cosine, ALL.0, ALL.1),
    function!("$tanh", f64::tanh, Decimal::hyperbolic_tangent, ALL.0, ALL.1),
    function!("$asinh", area_sine, Decimal::area_sine, ALL.0, ALL.1),
    function!("$acosh", area_cosine, Decimal::area_cosine, 1.0, ALL.1),
    function!("$atanh", area_tangent, Decimal::area_tangent, -1.0, 1.0),
    function!("$degreesToRadians", f64::to_radians, |angle| angle.times(degree()), ALL.0, ALL.1),
    function!("$radiansToDegrees", f64::to_degrees, |angle| angle.times(radian()), ALL.0, ALL.1),
    Operator { name: "$atan2", arity: (2, 2), call: arc_tangent },
];

/// Returns the inverse hyperbolic functions as C computes them, to the last digit; Rust's differ in it.
fn area_sine(x: f64) -> f64 {
    let size = x.abs();
    let result = match size {
        _ if !x.is_finite() || size < 2f64.powi(-28) => return x,
        _ if size > 2f64.powi(28) => size.ln() + LN_2,
        _ if size > 2.0 => (2.0 * size + 1.0 / ((x * x + 1.0).sqrt() + size)).ln(),
        _ => (size + x * x / (1.0 + (1.0 + x * x).sqrt())).ln_1p(),
    };
    result.copysign(x)
}

fn area_cosine(x: f64) -> f64 {
    match x {
        _ if x > 2f64.powi(28) => x.ln() + LN_2,
        _ if x > 2.0 => (2.0 * x - 1.0 / (x + (x * x - 1.0).sqrt())).ln(),
        _ => {
            let above = x - 1.0;
            (above + (2.0 * above + above * above).sqrt()).ln_1p()
        }
    }
}

fn area_tangent(x: f64) -> f64 {
    let size = x.abs();
    let twice = size + size;
    let result = match size {
        _ if size < 2f64.powi(-28) => return x,
        _ if size < 0.5 => (twice + twice * size / (1.0 - size)).ln_1p() / 2.0,
        _ => (twice / (1.0 - size)).ln_1p() / 2.0,
    };
    result.copysign(x)
}

/// Returns a degree in radians.
fn degree() -> Decimal {
    Decimal::parse("0.01745329251994329576923690768488613").unwrap_or(Decimal::NaN)
}

/// Returns a radian in degrees.
fn radian() -> Decimal {
    Decimal::parse("57.29577951308232087679815481410517").unwrap_or(Decimal::NaN)
}

fn apply(
    name: &str,
    values: &[Value],
    doubles: fn(f64) -> f64,
    decimals: fn(Decimal) -> Decimal,
    (low, high): (f64, f64),
) -> Result<Value> {
    let value = at(values, 0);
    if is_null(value) {
        return Ok(Some(Bson::Null));
    }
    let number = Number::of(value).ok_or_else(|| wrong_type(28_765, name, "a number", value))?;
    let double = number.to_double();
    if !double.is_nan() && !(low..=high).contains(&double) {
        return Err(QueryError::invalid(
            50_989,
            format!("cannot apply {name} to {double}: outside of [{low}, {high}]"),
        ));
    }
    Ok(Some(match number {
        Number::Decimal(decimal) => Bson::Decimal128(decimals(decimal).into()),
        _ => Bson::Double(doubles(double)),
    }))
}

fn arc_tangent(values: &[Value]) -> Result<Value> {
    let (y, x) = (at(values, 0), at(values, 1));
    if is_null(y) {
        return Ok(Some(Bson::Null));
    }
    let y = Number::of(y).ok_or_else(|| wrong_type(51_044, "$atan2", "numbers", y))?;
    if is_null(x) {
        return Ok(Some(Bson::Null));
    }
    let x = Number::of(x).ok_or_else(|| wrong_type(51_045, "$atan2", "numbers", x))?;
    Ok(Some(match (y, x) {
        (Number::Decimal(_), _) | (_, Number::Decimal(_)) => {
            Bson::Decimal128(y.to_decimal().arc_tangent_of(x.to_decimal()).into())
        }
        _ => Bson::Double(y.to_double().atan2(x.to_double())),
    }))
}
