//! Trigonometry, in radians.

use bson::Bson;

use super::Value;
use super::operator::{Operator, at, is_null, is_nullish, wrong_type};
use crate::query::decimal::Decimal;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;

/// An operator of one argument whose domain is all numbers, or an interval.
macro_rules! function {
    ($name:literal, $double:expr, $low:expr, $high:expr) => {
        Operator { name: $name, arity: (1, 1), call: |values| apply($name, values, $double, ($low, $high)) }
    };
}

const ALL: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
const FINITE: (f64, f64) = (f64::MIN, f64::MAX);

pub(super) const OPERATORS: [Operator; 15] = [
    function!("$sin", f64::sin, FINITE.0, FINITE.1),
    function!("$cos", f64::cos, FINITE.0, FINITE.1),
    function!("$tan", f64::tan, FINITE.0, FINITE.1),
    function!("$asin", f64::asin, -1.0, 1.0),
    function!("$acos", f64::acos, -1.0, 1.0),
    function!("$atan", f64::atan, ALL.0, ALL.1),
    function!("$sinh", f64::sinh, ALL.0, ALL.1),
    function!("$cosh", f64::cosh, ALL.0, ALL.1),
    function!("$tanh", f64::tanh, ALL.0, ALL.1),
    function!("$asinh", f64::asinh, ALL.0, ALL.1),
    function!("$acosh", f64::acosh, 1.0, ALL.1),
    function!("$atanh", f64::atanh, -1.0, 1.0),
    function!("$degreesToRadians", f64::to_radians, ALL.0, ALL.1),
    function!("$radiansToDegrees", f64::to_degrees, ALL.0, ALL.1),
    Operator { name: "$atan2", arity: (2, 2), call: arc_tangent },
];

fn apply(name: &str, values: &[Value], function: fn(f64) -> f64, (low, high): (f64, f64)) -> Result<Value> {
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
    Ok(Some(of_kind(number, function(double))))
}

fn arc_tangent(values: &[Value]) -> Result<Value> {
    if values.iter().any(is_nullish) {
        return Ok(Some(Bson::Null));
    }
    let (y, x) = (at(values, 0), at(values, 1));
    let y = Number::of(y).ok_or_else(|| wrong_type(51_044, "$atan2", "numbers", y))?;
    let x = Number::of(x).ok_or_else(|| wrong_type(51_045, "$atan2", "numbers", x))?;
    let angle = y.to_double().atan2(x.to_double());
    Ok(Some(of_kind(if matches!(x, Number::Decimal(_)) { x } else { y }, angle)))
}

/// A decimal where the argument was one.
fn of_kind(argument: Number, result: f64) -> Bson {
    match argument {
        Number::Decimal(_) => Bson::Decimal128(Decimal::from_double(result).into()),
        _ => Bson::Double(result),
    }
}
