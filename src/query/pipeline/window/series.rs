//! Window functions of numeric series: slope, area, and moving average.

use bson::{Bson, Document};

use super::bounds::Moving;
use super::column::{Column, evaluate};
use super::member::{Member, number, wrong};
use super::partition::Partition;
use crate::query::arithmetic::{Overflow, add, multiply, subtract};
use crate::query::decimal::Decimal;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope, Unit, Value};
use crate::query::number::Number;
use crate::query::pipeline::run::Run;
use crate::query::statistics::Sum;

pub(super) fn is_null(value: Option<&Bson>) -> bool {
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

    pub(super) fn column<'a, E>(&'a self, windows: Moving<'a>) -> Column<'a, E> {
        if self.integral { self.areas(windows) } else { self.slopes(windows) }
    }

    fn slopes<'a, E>(&'a self, mut windows: Moving<'a>) -> Column<'a, E> {
        Box::new(move |partition, index, run| {
            // Also what is in no window has to have a place.
            self.point(partition, index, run)?;
            let window = windows.at(partition, index)?;
            let (Some(last), false) = (window.end.checked_sub(1), window.is_empty()) else {
                return Ok(Some(Bson::Null));
            };
            let ends = (self.point(partition, window.start, run)?, self.point(partition, last, run)?);
            let (Some(first), Some(last)) = ends else { return Ok(Some(Bson::Null)) };
            slope(&first, &last, window.len(), self.unit).map(Some)
        })
    }

    fn areas<'a, E>(&'a self, mut windows: Moving<'a>) -> Column<'a, E> {
        let empty = || Area { unit: self.unit, ..Area::default() };
        let (mut area, mut done) = (empty(), 0..0);
        Box::new(move |partition, index, run| {
            self.point(partition, index, run)?;
            let window = windows.at(partition, index)?;
            if window.start != done.start || window.end < done.end {
                (area, done) = (empty(), window.start..window.start);
            }
            for number in done.end..window.end {
                let Some((x, y)) = self.point(partition, number, run)? else { break };
                area.add(x, y.as_ref())?;
            }
            done = window;
            Ok(Some(area.value()))
        })
    }

    fn point<E>(&self, partition: &Partition<'_>, index: usize, run: &Run<'_, E>) -> Result<Option<(Number, Value)>> {
        let Some(member) = partition.get(index)? else { return Ok(None) };
        Ok(Some((self.at(&member)?, evaluate(&self.input, &member, run)?)))
    }

    /// The place of a document: a number, or of a date its milliseconds.
    fn at(&self, member: &Member) -> Result<Number> {
        match (member.at.as_ref(), self.unit) {
            (Some(Bson::DateTime(date)), Some(_)) => Ok(Number::Long(date.timestamp_millis())),
            (_, Some(_)) => Err(QueryError::invalid(5_624_900, "a sortBy with a 'unit' must give dates")),
            (Some(Bson::DateTime(_)), None) => Err(QueryError::invalid(5_624_901, "a sortBy of dates needs a 'unit'")),
            (at, None) => {
                number(at).ok_or_else(|| QueryError::invalid(5_624_902, "the sortBy must give numbers or dates"))
            }
        }
    }
}

/// The slope between two of so many points, whose places are so many units.
fn slope((x1, y1): &(Number, Value), (x2, y2): &(Number, Value), count: usize, unit: Option<Unit>) -> Result<Bson> {
    let (Some(y1), Some(y2)) = (number(y1.as_ref()), number(y2.as_ref())) else {
        let code = if is_null(y1.as_ref()) || is_null(y2.as_ref()) { 5_624_903 } else { 14 };
        return Err(QueryError::invalid(code, "the input of $derivative must be numbers").about("$derivative"));
    };
    let width = subtract(*x2, *x1, Overflow::Double)?;
    if count < 2 || width.is_zero() {
        return Ok(Bson::Null);
    }
    let slope = quotient(subtract(y2, y1, Overflow::Double)?, width);
    // mongod counts dates in milliseconds, which decimals show.
    let slope = unit.map_or(Ok(slope), |unit| multiply(slope, Number::Long(unit.millis()), Overflow::Double))?;
    Ok(slope.into())
}

/// The area under points, by trapezoids.
#[derive(Debug, Default)]
struct Area {
    sum: Sum,
    last: Option<(Number, Number)>,
    has_area: bool,
    unit: Option<Unit>,
}

impl Area {
    fn add(&mut self, x: Number, y: Option<&Bson>) -> Result<()> {
        let y = number(y).ok_or_else(|| {
            QueryError::invalid(5_423_900, "the input of $integral must be numbers").about("$integral")
        })?;
        if let Some((before, height)) = self.last {
            let (width, heights) = (subtract(x, before, Overflow::Double)?, add(height, y, Overflow::Double)?);
            // By a double, as in mongod: as a divisor it gives decimals their exponent.
            self.sum.add(quotient(multiply(width, heights, Overflow::Double)?, Number::Double(2.0)));
            self.has_area = true;
        }
        self.last = Some((x, y));
        Ok(())
    }

    fn value(&self) -> Bson {
        let area = match self.last {
            None => return Bson::Null,
            Some(_) if self.has_area => self.sum.total(),
            Some(_) => Number::Int(0),
        };
        self.unit.map_or(area, |unit| quotient(area, Number::Long(unit.millis()))).into()
    }
}

/// The quotient; with a decimal in it, a decimal.
fn quotient(a: Number, b: Number) -> Number {
    match (a, b) {
        (Number::Decimal(a), b) => Number::Decimal(a.over(b.to_decimal())),
        (a, Number::Decimal(b)) => Number::Decimal(a.to_decimal().over(b)),
        (a, b) => Number::Double(a.to_double() / b.to_double()),
    }
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
    pub(super) fn column<E>(&self) -> Column<'_, E> {
        let rest = Number::Double(1.0).to_decimal().minus(self.alpha);
        let (mut average, mut is_decimal) = (None, false);
        Box::new(move |partition, index, run| {
            let value = partition.get(index)?.map(|member| evaluate(&self.input, &member, run)).transpose()?.flatten();
            if let Some(number) = number(value.as_ref()) {
                is_decimal |= matches!(number, Number::Decimal(_));
                let number = number.to_decimal();
                average =
                    Some(average.map_or(number, |average: Decimal| number.times(self.alpha).plus(average.times(rest))));
            }
            Ok(Some(match average {
                None => Bson::Null,
                Some(average) if is_decimal => Bson::Decimal128(average.into()),
                Some(average) => Bson::Double(average.to_double()),
            }))
        })
    }
}
