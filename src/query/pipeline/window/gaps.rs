//! Window functions that fill gaps.

use bson::Bson;

use super::column::{Column, evaluate};
use super::member::{Member, number};
use super::partition::Partition;
use super::real::Real;
use super::series::is_null;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope, Value};
use crate::query::number::Number;
use crate::query::pipeline::run::Run;

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

    pub(super) fn column<E>(&self) -> Column<'_, E> {
        if self.linear { self.interpolated() } else { self.carried() }
    }

    /// Returns the value of a document, unless it is null.
    fn known<E>(&self, member: &Member, run: &Run<'_, E>) -> Result<Value> {
        Ok(evaluate(&self.input, member, run)?.filter(|value| !is_null(Some(value))))
    }

    /// The last value that is not null is carried forward.
    fn carried<E>(&self) -> Column<'_, E> {
        let mut last = Bson::Null;
        Box::new(move |partition, index, run| {
            let known = partition.get(index)?.map(|member| self.known(&member, run)).transpose()?.flatten();
            if let Some(value) = known {
                last = value;
            }
            Ok(Some(last.clone()))
        })
    }

    /// Gaps between two numbers are filled along the line between them.
    fn interpolated<E>(&self) -> Column<'_, E> {
        // The value before the gap and the one after it, each with the number of its document.
        let (mut before, mut after): (Option<Known>, Option<Known>) = (None, None);
        let mut is_checked = false;
        Box::new(move |partition, index, run| {
            if !std::mem::replace(&mut is_checked, true) {
                check_places(partition)?;
                after = self.next_known(partition, 0, run)?;
            }
            if let Some(known) = after.take_if(|known| known.0 <= index) {
                let value = known.1.clone();
                after = self.next_known(partition, index + 1, run)?;
                check_numbers(&known, after.as_ref())?;
                before = Some(known);
                return Ok(Some(value));
            }
            Ok(Some(line(partition, before.as_ref().zip(after.as_ref()), index)?.unwrap_or(Bson::Null)))
        })
    }

    /// Returns the first value from a document on that is not null.
    fn next_known<E>(&self, partition: &Partition<'_>, from: usize, run: &Run<'_, E>) -> Result<Option<Known>> {
        for index in from..partition.len() {
            let Some(member) = partition.get(index)? else { break };
            if let Some(value) = self.known(&member, run)? {
                return Ok(Some((index, value)));
            }
        }
        Ok(None)
    }
}

/// A value that is not null, with the number of its document.
type Known = (usize, Bson);

/// Refuses values on both sides of a gap that are no numbers.
fn check_numbers(before: &Known, after: Option<&Known>) -> Result<()> {
    match after {
        Some(after) if value(Some(&before.1)).is_none() || value(Some(&after.1)).is_none() => {
            Err(QueryError::type_mismatch("the input of $linearFill must be numbers").about("$linearFill"))
        }
        _ => Ok(()),
    }
}

/// The value at a document on the line between two.
fn line(partition: &Partition<'_>, ends: Option<(&Known, &Known)>, index: usize) -> Result<Option<Bson>> {
    let Some((before, after)) = ends else { return Ok(None) };
    let at = |index: usize| Ok::<_, QueryError>(partition.get(index)?.and_then(|member| place(&member)));
    let (Some(x1), Some(x2), Some(x)) = (at(before.0)?, at(after.0)?, at(index)?) else { return Ok(None) };
    let (Some(y1), Some(y2)) = (value(Some(&before.1)), value(Some(&after.1))) else { return Ok(None) };
    let slope = y2.minus(y1).over(x2.minus(x1));
    Ok(Some(y1.plus(x.minus(x1).times(slope)).into()))
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

/// Refuses places that are equal, or are no numbers.
fn check_places(partition: &Partition<'_>) -> Result<()> {
    let (mut before, mut are_numbers) = (None, true);
    for index in 0..partition.len() {
        let Some(member) = partition.get(index)? else { break };
        if before.as_ref() == Some(&member.place) {
            return Err(QueryError::invalid(6_050_106, "the sortBy of $linearFill may not give equal values")
                .about("$linearFill"));
        }
        are_numbers &= place(&member).is_some();
        before = Some(member.place.clone());
    }
    match are_numbers {
        true => Ok(()),
        false => {
            Err(QueryError::type_mismatch("the sortBy of $linearFill must give numbers or dates").about("$linearFill"))
        }
    }
}
