//! Window functions of numeric series: slope, area, moving average, and filling of gaps.

use std::ops::Range;

use bson::{Bson, Document};

use super::member::{Member, number, wrong};
use crate::query::decimal::Decimal;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope, Unit, Value};
use crate::query::number::Number;
use crate::query::pipeline::run::Run;

/// A number as a double, or as a decimal where a decimal takes part.
#[derive(Debug, Clone, Copy)]
enum Real {
    Double(f64),
    Decimal(Decimal),
}

impl From<Number> for Real {
    fn from(number: Number) -> Self {
        match number {
            Number::Decimal(decimal) => Self::Decimal(decimal),
            other => Self::Double(other.to_double()),
        }
    }
}

impl From<Real> for Bson {
    fn from(real: Real) -> Self {
        match real {
            Real::Double(double) => Self::Double(double),
            Real::Decimal(decimal) => Self::Decimal128(decimal.into()),
        }
    }
}

impl Real {
    fn with(self, other: Self, double: fn(f64, f64) -> f64, decimal: fn(Decimal, Decimal) -> Decimal) -> Self {
        match (self, other) {
            (Self::Double(a), Self::Double(b)) => Self::Double(double(a, b)),
            (a, b) => Self::Decimal(decimal(a.decimal(), b.decimal())),
        }
    }

    fn decimal(self) -> Decimal {
        match self {
            Self::Double(double) => Number::Double(double).to_decimal(),
            Self::Decimal(decimal) => decimal,
        }
    }

    fn plus(self, other: Self) -> Self {
        self.with(other, |a, b| a + b, Decimal::plus)
    }

    fn minus(self, other: Self) -> Self {
        self.with(other, |a, b| a - b, Decimal::minus)
    }

    fn times(self, other: Self) -> Self {
        self.with(other, |a, b| a * b, Decimal::times)
    }

    fn over(self, other: Self) -> Self {
        self.with(other, |a, b| a / b, Decimal::over)
    }
}

fn evaluate<E>(expression: &Expression, member: &Member, run: &Run<'_, E>) -> Result<Value> {
    expression.evaluate(&run.environment((&*member.document).into()))
}

fn is_null(value: Option<&Bson>) -> bool {
    matches!(value, None | Some(Bson::Null | Bson::Undefined))
}

/// Reads an object with these fields only.
fn object<'a>(name: &str, argument: &'a Bson, known: &[&str]) -> Result<&'a Document> {
    let Bson::Document(spec) = argument else { return Err(wrong(format!("{name} needs an object"))) };
    match spec.keys().find(|key| !known.contains(&key.as_str())) {
        Some(key) => Err(wrong(format!("{name} has the unknown argument: {key}"))),
        None => Ok(spec),
    }
}

/// `$derivative` and `$integral`, over the field that is sorted by.
#[derive(Debug)]
pub(super) struct Slope {
    input: Expression,
    unit: Option<Unit>,
    integral: bool,
}

impl Slope {
    pub(super) fn parse(name: &str, argument: &Bson, is_sorted: bool, scope: &Scope) -> Result<Self> {
        let spec = object(name, argument, &["input", "unit"])?;
        let input = spec.get("input").ok_or_else(|| wrong(format!("{name} needs 'input'")))?;
        if !is_sorted {
            return Err(wrong(format!("{name} needs a sortBy of one field")));
        }
        let unit = match spec.get("unit") {
            None => None,
            Some(Bson::String(unit)) => {
                let unit = Unit::parse(unit).ok_or_else(|| wrong(format!("unknown time unit value: {unit}")))?;
                if unit.months().is_some() {
                    return Err(QueryError::invalid(
                        5_490_710,
                        format!("the 'unit' of {name} must have a fixed length"),
                    ));
                }
                Some(unit)
            }
            Some(_) => return Err(QueryError::type_mismatch(format!("the 'unit' of {name} must be a string"))),
        };
        Ok(Self { input: Expression::parse_in(input, scope)?, unit, integral: name == "$integral" })
    }

    pub(super) fn values<E>(
        &self,
        partition: &[Member],
        windows: &[Range<usize>],
        run: &Run<'_, E>,
    ) -> Result<Vec<Bson>> {
        let mut points = Vec::with_capacity(partition.len());
        for member in partition {
            points.push((self.at(member)?, evaluate(&self.input, member, run)?));
        }
        let value = |window: &Range<usize>| {
            let points = points.get(window.clone()).unwrap_or_default();
            if self.integral { area(points) } else { slope(points) }
        };
        windows.iter().map(value).collect()
    }

    /// The place of a document: a number, or a date in units.
    fn at(&self, member: &Member) -> Result<Real> {
        match (member.at.as_ref(), self.unit) {
            #[expect(clippy::cast_precision_loss, reason = "as mongod divides")]
            (Some(Bson::DateTime(date)), Some(unit)) => {
                Ok(Real::Double(date.timestamp_millis() as f64 / unit.millis() as f64))
            }
            (_, Some(_)) => Err(QueryError::invalid(5_624_900, "a sortBy with a 'unit' must give dates")),
            (Some(Bson::DateTime(_)), None) => Err(QueryError::invalid(5_624_901, "a sortBy of dates needs a 'unit'")),
            (at, None) => match number(at) {
                Some(number) => Ok(number.into()),
                None => Err(QueryError::invalid(5_624_902, "the sortBy must give numbers or dates")),
            },
        }
    }
}

fn slope(points: &[(Real, Value)]) -> Result<Bson> {
    let (Some((x1, y1)), Some((x2, y2))) = (points.first(), points.last()) else { return Ok(Bson::Null) };
    let (Some(y1), Some(y2)) = (number(y1.as_ref()), number(y2.as_ref())) else {
        return match is_null(y1.as_ref()) || is_null(y2.as_ref()) {
            true => Ok(Bson::Null),
            false => Err(QueryError::invalid(5_624_903, "the input of $derivative must be numbers")),
        };
    };
    let width = x2.minus(*x1);
    if points.len() < 2 || matches!(width, Real::Double(0.0)) {
        return Ok(Bson::Null);
    }
    Ok(Real::from(y2).minus(y1.into()).over(width).into())
}

/// The area under the points, by trapezoids; what is no number is left out.
fn area(points: &[(Real, Value)]) -> Result<Bson> {
    let numbers: Vec<(Real, Real)> =
        points.iter().filter_map(|(x, y)| Some((*x, number(y.as_ref())?.into()))).collect();
    let mut sum = Real::Double(0.0);
    for pair in numbers.windows(2) {
        if let [(x1, y1), (x2, y2)] = pair {
            sum = sum.plus(x2.minus(*x1).times(y1.plus(*y2)).over(Real::Double(2.0)));
        }
    }
    Ok(match numbers.len() {
        0 => Bson::Null,
        1 => Bson::Int32(0),
        _ => sum.into(),
    })
}

/// `$expMovingAvg`.
#[derive(Debug)]
pub(super) struct MovingAverage {
    input: Expression,
    alpha: Decimal,
}

impl MovingAverage {
    pub(super) fn parse(argument: &Bson, is_sorted: bool, scope: &Scope) -> Result<Self> {
        let spec = object("$expMovingAvg", argument, &["input", "N", "alpha"])?;
        let input = spec.get("input").ok_or_else(|| wrong("$expMovingAvg needs 'input'"))?;
        if !is_sorted {
            return Err(wrong("$expMovingAvg needs a sortBy"));
        }
        let alpha = match (spec.get("N"), spec.get("alpha")) {
            (Some(n), None) => {
                let n = Number::of(n).and_then(Number::integral).filter(|n| *n > 0);
                let n = n.ok_or_else(|| wrong("the 'N' of $expMovingAvg must be a positive integer"))?;
                Decimal::from_integer(2).over(Decimal::from_integer(i128::from(n) + 1))
            }
            (None, Some(alpha)) => {
                let alpha = Number::of(alpha).filter(|alpha| (0.0..1.0).contains(&alpha.to_double()));
                let alpha = alpha.filter(|alpha| !alpha.is_zero());
                alpha.ok_or_else(|| wrong("the 'alpha' of $expMovingAvg must be between 0 and 1"))?.to_decimal()
            }
            _ => return Err(wrong("$expMovingAvg needs either 'N' or 'alpha'")),
        };
        Ok(Self { input: Expression::parse_in(input, scope)?, alpha })
    }

    /// The average is a decimal at each step, as in mongod, and is given as one where a decimal is in it.
    pub(super) fn values<E>(&self, partition: &[Member], run: &Run<'_, E>) -> Result<Vec<Bson>> {
        let rest = Number::Double(1.0).to_decimal().minus(self.alpha);
        let (mut values, mut average, mut is_decimal) = (Vec::with_capacity(partition.len()), None, false);
        for member in partition {
            if let Some(number) = number(evaluate(&self.input, member, run)?.as_ref()) {
                is_decimal |= matches!(number, Number::Decimal(_));
                let number = number.to_decimal();
                average =
                    Some(average.map_or(number, |average: Decimal| number.times(self.alpha).plus(average.times(rest))));
            }
            values.push(match average {
                None => Bson::Null,
                Some(average) if is_decimal => Bson::Decimal128(average.into()),
                Some(average) => Bson::Double(average.to_double()),
            });
        }
        Ok(values)
    }
}

/// `$linearFill` and `$locf`: values in the place of null and missing ones.
#[derive(Debug)]
pub(super) struct Fill {
    input: Expression,
    linear: bool,
}

impl Fill {
    pub(super) fn parse(name: &str, argument: &Bson, is_sorted: bool, scope: &Scope) -> Result<Self> {
        let linear = name == "$linearFill";
        if linear && !is_sorted {
            return Err(QueryError::invalid(605_001, "$linearFill needs a sortBy of one field"));
        }
        Ok(Self { input: Expression::parse_in(argument, scope)?, linear })
    }

    pub(super) fn values<E>(&self, partition: &[Member], run: &Run<'_, E>) -> Result<Vec<Bson>> {
        let mut values = Vec::with_capacity(partition.len());
        for member in partition {
            values.push(evaluate(&self.input, member, run)?.filter(|value| !is_null(Some(value))));
        }
        if self.linear { interpolated(partition, &values) } else { Ok(carried(values)) }
    }
}

/// The last value that is not null is carried forward.
fn carried(values: Vec<Value>) -> Vec<Bson> {
    let mut last = Bson::Null;
    let carry = |value: Value| {
        if let Some(value) = value {
            last = value;
        }
        last.clone()
    };
    values.into_iter().map(carry).collect()
}

/// Gaps between two numbers are filled along the line between them.
fn interpolated(partition: &[Member], values: &[Value]) -> Result<Vec<Bson>> {
    let mut filled: Vec<Bson> = values.iter().map(|value| value.clone().unwrap_or(Bson::Null)).collect();
    let known: Vec<usize> = (0..values.len()).filter(|index| values.get(*index).is_some_and(Option::is_some)).collect();
    check_places(partition)?;
    for pair in known.windows(2) {
        let [from, to] = pair else { continue };
        let point = |index: usize| Some((place(partition.get(index)?)?, value(values.get(index)?.as_ref())?));
        let (Some((x1, y1)), Some((x2, y2))) = (point(*from), point(*to)) else {
            return Err(QueryError::type_mismatch("the input of $linearFill must be numbers"));
        };
        for index in from + 1..*to {
            let Some(x) = partition.get(index).and_then(place) else { continue };
            let slope = y2.minus(y1).over(x2.minus(x1));
            if let Some(slot) = filled.get_mut(index) {
                *slot = y1.plus(x.minus(x1).times(slope)).into();
            }
        }
    }
    Ok(filled)
}

fn value(value: Option<&Bson>) -> Option<Real> {
    number(value).map(Real::from)
}

/// The place of a document: a number, or a date in milliseconds.
fn place(member: &Member) -> Option<Real> {
    match member.at.as_ref() {
        Some(Bson::DateTime(date)) => Some(Number::Long(date.timestamp_millis()).into()),
        at => value(at),
    }
}

fn check_places(partition: &[Member]) -> Result<()> {
    for pair in partition.windows(2) {
        if let [a, b] = pair
            && a.place == b.place
        {
            return Err(QueryError::invalid(6_050_106, "the sortBy of $linearFill may not give equal values"));
        }
    }
    match partition.iter().all(|member| place(member).is_some()) {
        true => Ok(()),
        false => Err(QueryError::type_mismatch("the sortBy of $linearFill must give numbers or dates")),
    }
}
