//! Window functions: accumulators over windows, and functions of the order.

use std::ops::Range;

use bson::{Bson, Document};

use super::bounds::Bounds;
use super::covariance::Covariance;
use super::member::{Member, wrong};
use super::order::Order;
use super::rolling::{Deviation, rolled};
use super::series::{Fill, MovingAverage, Slope};
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope, Value, constant_of};
use crate::query::number::Number;
use crate::query::pipeline::accumulator::{Accumulator, count};
use crate::query::pipeline::run::Run;
use crate::query::view::Fields;

/// A compiled window function.
#[derive(Debug)]
pub(super) enum Function {
    Accumulate(Accumulator),
    /// `$sum` over a window that moves at both ends: a sum that fits is an int, also of longs.
    Sum(Accumulator),
    /// `$first` and `$last`, which give nothing where the value is missing.
    End {
        input: Expression,
        last: bool,
    },
    Rank(Rank),
    Shift {
        output: Expression,
        by: i64,
        default: Bson,
    },
    /// `$stdDevPop` and `$stdDevSamp` over a window that moves at both ends.
    Deviation {
        input: Expression,
        sample: bool,
    },
    Covariance(Covariance),
    Slope(Slope),
    MovingAverage(MovingAverage),
    Fill(Fill),
}

/// The functions that number documents.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rank {
    Sparse,
    Dense,
    Number,
}

const ACCUMULATORS: [&str; 16] = [
    "$sum",
    "$avg",
    "$min",
    "$max",
    "$push",
    "$addToSet",
    "$stdDevPop",
    "$stdDevSamp",
    "$count",
    "$firstN",
    "$lastN",
    "$minN",
    "$maxN",
    "$top",
    "$bottom",
    "$topN",
];

impl Function {
    pub(super) fn parse(
        name: &str,
        argument: &Bson,
        order: &Order,
        bounds: Option<&Bounds>,
        scope: &Scope,
    ) -> Result<Self> {
        let rank = |rank: Rank| {
            if !matches!(argument, Bson::Document(argument) if argument.is_empty()) {
                return Err(QueryError::invalid(5_371_603, format!("{name} takes {{}} as its argument")));
            }
            if bounds.is_some() {
                return Err(QueryError::invalid(5_371_601, format!("{name} takes no window")));
            }
            if !order.is_by_one() {
                return Err(QueryError::invalid(5_371_602, format!("{name} needs a sortBy of exactly one field")));
            }
            Ok(Self::Rank(rank))
        };
        match name {
            "$rank" => rank(Rank::Sparse),
            "$denseRank" => rank(Rank::Dense),
            "$documentNumber" => rank(Rank::Number),
            "$shift" => shift(argument, order, bounds, scope),
            "$covariancePop" | "$covarianceSamp" => Ok(Self::Covariance(Covariance::parse(name, argument, scope)?)),
            "$derivative" | "$integral" => {
                if name == "$derivative" && bounds.is_none() {
                    return Err(wrong("$derivative needs a window with explicit bounds"));
                }
                Ok(Self::Slope(Slope::parse(name, argument, order.is_by_one(), scope)?))
            }
            "$expMovingAvg" => {
                if bounds.is_some() {
                    return Err(wrong("$expMovingAvg takes no window"));
                }
                Ok(Self::MovingAverage(MovingAverage::parse(argument, order.is_sorted(), scope)?))
            }
            "$linearFill" | "$locf" => {
                if bounds.is_some() {
                    return Err(wrong(format!("{name} takes no window")));
                }
                Ok(Self::Fill(Fill::parse(name, argument, order.is_by_one(), scope)?))
            }
            "$first" | "$last" => {
                Ok(Self::End { input: Expression::parse_in(argument, scope)?, last: name == "$last" })
            }
            "$stdDevPop" | "$stdDevSamp" if bounds.is_some_and(Bounds::leaves) => {
                Ok(Self::Deviation { input: Expression::parse_in(argument, scope)?, sample: name == "$stdDevSamp" })
            }
            _ if ACCUMULATORS.contains(&name) || name == "$bottomN" => {
                let spec = Document::from_iter([(name.to_owned(), argument.clone())]);
                let accumulator = Accumulator::of_window(&Bson::Document(spec), scope)?;
                Ok(match name == "$sum" && bounds.is_some_and(Bounds::leaves) {
                    true => Self::Sum(accumulator),
                    false => Self::Accumulate(accumulator),
                })
            }
            _ => Err(wrong(format!("unrecognized window function, {name}"))),
        }
    }

    /// Returns the value for each document of a partition.
    pub(super) fn values<E>(
        &self,
        partition: &[Member],
        windows: &[Range<usize>],
        run: &Run<'_, E>,
    ) -> Result<Vec<Value>> {
        let values = match self {
            Self::End { input, last } => return ends(input, *last, partition, windows, run),
            Self::Shift { output, by, default } => return shifted(output, *by, default, partition, run),
            Self::Accumulate(accumulator) => accumulated(accumulator, partition, windows, run)?,
            Self::Sum(accumulator) => {
                let narrow = |sum: Bson| match sum {
                    Bson::Int64(long) => i32::try_from(long).map_or(Bson::Int64(long), Bson::Int32),
                    sum => sum,
                };
                accumulated(accumulator, partition, windows, run)?.into_iter().map(narrow).collect()
            }
            Self::Rank(rank) => ranks(*rank, partition),
            Self::Deviation { input, sample } => {
                let number =
                    |member| Ok(input.evaluate(&run.environment(fields(member)))?.as_ref().and_then(Number::of));
                let numbers: Vec<_> = partition.iter().map(number).collect::<Result<_>>()?;
                rolled(&numbers, windows, || Deviation::new(*sample))?
            }
            Self::Covariance(covariance) => covariance.values(partition, windows, run)?,
            Self::Slope(slope) => slope.values(partition, windows, run)?,
            Self::MovingAverage(average) => average.values(partition, run)?,
            Self::Fill(fill) => fill.values(partition, run)?,
        };
        Ok(values.into_iter().map(Some).collect())
    }
}

fn fields(member: &Member) -> Fields<'_> {
    (&*member.document).into()
}

/// The value of an accumulator over each window. What one window shares with the one before is not added again, as
/// long as windows only grow.
fn accumulated<E>(
    accumulator: &Accumulator,
    partition: &[Member],
    windows: &[Range<usize>],
    run: &Run<'_, E>,
) -> Result<Vec<Bson>> {
    let mut values: Vec<Bson> = Vec::with_capacity(windows.len());
    let mut state = accumulator.start(&Bson::Null, run)?;
    let mut done = 0..0;
    for window in windows {
        if *window == done
            && let Some(last) = values.last()
        {
            values.push(last.clone());
            continue;
        }
        if window.start != done.start || window.end < done.end {
            state = accumulator.start(&Bson::Null, run)?;
            done = window.start..window.start;
        }
        for member in partition.get(done.end..window.end).unwrap_or_default() {
            accumulator.add(&mut state, fields(member), run)?;
        }
        done = window.clone();
        values.push(accumulator.finish(state.clone())?);
    }
    Ok(values)
}

/// The value of the first or last document of each window; null where a window is empty.
fn ends<E>(
    input: &Expression,
    last: bool,
    partition: &[Member],
    windows: &[Range<usize>],
    run: &Run<'_, E>,
) -> Result<Vec<Value>> {
    let value = |window: &Range<usize>| {
        let members = partition.get(window.clone()).unwrap_or_default();
        match if last { members.last() } else { members.first() } {
            Some(member) => input.evaluate(&run.environment(fields(member))),
            None => Ok(Some(Bson::Null)),
        }
    };
    windows.iter().map(value).collect()
}

fn ranks(rank: Rank, partition: &[Member]) -> Vec<Bson> {
    let (mut values, mut current, mut before) = (Vec::with_capacity(partition.len()), 0i64, None);
    for (member, number) in partition.iter().zip(1i64..) {
        if before != Some(&member.place) || rank == Rank::Number {
            current = if rank == Rank::Dense { current + 1 } else { number };
        }
        before = Some(&member.place);
        values.push(count(current));
    }
    values
}

fn shift(argument: &Bson, order: &Order, bounds: Option<&Bounds>, scope: &Scope) -> Result<Function> {
    let Bson::Document(spec) = argument else { return Err(wrong("$shift needs an object")) };
    if bounds.is_some() {
        return Err(wrong("$shift takes no window"));
    }
    if let Some(name) = spec.keys().find(|name| !matches!(name.as_str(), "output" | "by" | "default")) {
        return Err(wrong(format!("$shift has the unknown argument: {name}")));
    }
    let output = spec.get("output").ok_or_else(|| wrong("$shift needs 'output'"))?;
    let by = spec.get("by").ok_or_else(|| wrong("$shift needs 'by'"))?;
    let by = Number::of(by).and_then(Number::integral).ok_or_else(|| wrong("the 'by' of $shift must be an integer"))?;
    if !order.is_sorted() {
        return Err(wrong("$shift needs a sortBy"));
    }
    let default = spec.get("default").map(|value| constant_of(value, scope)).transpose()?.unwrap_or(Bson::Null);
    Ok(Function::Shift { output: Expression::parse_in(output, scope)?, by, default })
}

fn shifted<E>(
    output: &Expression,
    by: i64,
    default: &Bson,
    partition: &[Member],
    run: &Run<'_, E>,
) -> Result<Vec<Value>> {
    let value = |index: usize| {
        let index = i64::try_from(index).ok().and_then(|index| index.checked_add(by));
        match index.and_then(|index| usize::try_from(index).ok()).and_then(|index| partition.get(index)) {
            Some(member) => output.evaluate(&run.environment(fields(member))),
            None => Ok(Some(default.clone())),
        }
    };
    (0..partition.len()).map(value).collect()
}
