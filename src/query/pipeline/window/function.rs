//! Window functions: accumulators over windows, and functions of the order.

use bson::{Bson, Document};

use super::bounds::{Bounds, Moving};
use super::column::{Column, accumulated, ends, evaluate, shifted};
use super::covariance::Covariance;
use super::gaps::Fill;
use super::member::{Member, wrong};
use super::order::Order;
use super::rolling::{Deviation, rolled};
use super::series::{MovingAverage, Slope};
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope, constant_of};
use crate::query::number::Number;
use crate::query::pipeline::accumulator::{Accumulator, count};
use crate::query::pipeline::run::Run;

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

    /// Returns the function that gives the value for each document of a partition.
    pub(super) fn column<'a, E: 'a>(&'a self, windows: Moving<'a>) -> Column<'a, E> {
        match self {
            Self::End { input, last } => ends(input, *last, windows),
            Self::Shift { output, by, default } => shifted(output, *by, default),
            Self::Accumulate(accumulator) => accumulated(accumulator, windows),
            Self::Sum(accumulator) => {
                let narrow = |sum: Bson| match sum {
                    Bson::Int64(long) => i32::try_from(long).map_or(Bson::Int64(long), Bson::Int32),
                    sum => sum,
                };
                let mut sums = accumulated(accumulator, windows);
                Box::new(move |partition, index, run| Ok(sums(partition, index, run)?.map(narrow)))
            }
            Self::Rank(rank) => ranks(*rank),
            Self::Deviation { input, sample } => {
                let number =
                    |member: &Member, run: &Run<'_, E>| Ok(evaluate(input, member, run)?.as_ref().and_then(Number::of));
                rolled(number, windows, || Deviation::new(*sample))
            }
            Self::Covariance(covariance) => covariance.column(windows),
            Self::Slope(slope) => slope.column(windows),
            Self::MovingAverage(average) => average.column(),
            Self::Fill(fill) => fill.column(),
        }
    }
}

fn ranks<'a, E>(rank: Rank) -> Column<'a, E> {
    let (mut current, mut before) = (0i64, None);
    Box::new(move |partition, index, _| {
        let place = partition.get(index)?.map(|member| member.place.clone());
        if before != Some(place.clone()) || rank == Rank::Number {
            let number = i64::try_from(index).unwrap_or(i64::MAX).saturating_add(1);
            current = if rank == Rank::Dense { current + 1 } else { number };
        }
        before = Some(place);
        Ok(Some(count(current)))
    })
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
