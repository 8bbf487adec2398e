//! The values of a window function, document after document.

use std::ops::Range;

use bson::Bson;

use super::bounds::Moving;
use super::member::Member;
use super::partition::Partition;
use crate::query::error::Result;
use crate::query::expression::{Expression, Value};
use crate::query::pipeline::accumulator::Accumulator;
use crate::query::pipeline::run::Run;
use crate::query::pipeline::state::State;

/// Returns the value for the document with this number; documents are asked for in their order.
pub(super) type Column<'a, E> = Box<dyn FnMut(&Partition<'_>, usize, &Run<'_, E>) -> Result<Value> + 'a>;

/// Evaluates an expression for a document.
pub(super) fn evaluate<E>(expression: &Expression, member: &Member, run: &Run<'_, E>) -> Result<Value> {
    expression.evaluate(&run.environment((&*member.document).into()))
}

/// The value of an accumulator over each window. What one window shares with the one before is not added again, as
/// long as windows only grow.
pub(super) fn accumulated<'a, E>(accumulator: &'a Accumulator, mut windows: Moving<'a>) -> Column<'a, E> {
    let mut state: Option<State> = None;
    let mut done: Range<usize> = 0..0;
    let mut last = None;
    Box::new(move |partition, index, run| {
        let window = windows.at(partition, index)?;
        if let Some(value) = last.as_ref().filter(|_| window == done) {
            return Ok(Some(Bson::clone(value)));
        }
        let mut sum = match state.take() {
            Some(state) if window.start == done.start && window.end >= done.end => state,
            _ => {
                done = window.start..window.start;
                accumulator.start(&Bson::Null, run)?
            }
        };
        for number in done.end..window.end {
            if let Some(member) = partition.get(number)? {
                accumulator.add(&mut sum, (&*member.document).into(), run)?;
            }
        }
        done = window;
        let value = accumulator.finish(sum.clone())?;
        state = Some(sum);
        last = Some(value.clone());
        Ok(Some(value))
    })
}

/// The value of the first or last document of each window; null where a window is empty.
pub(super) fn ends<'a, E>(input: &'a Expression, is_last: bool, mut windows: Moving<'a>) -> Column<'a, E> {
    Box::new(move |partition, index, run| {
        let window = windows.at(partition, index)?;
        let end = if is_last { window.end.checked_sub(1) } else { Some(window.start) };
        match end.filter(|end| window.contains(end)).map(|end| partition.get(end)).transpose()?.flatten() {
            Some(member) => evaluate(input, &member, run),
            None => Ok(Some(Bson::Null)),
        }
    })
}

/// The value of the document that comes so many after each one.
pub(super) fn shifted<'a, E>(output: &'a Expression, by: i64, default: &'a Bson) -> Column<'a, E> {
    Box::new(move |partition, index, run| {
        let index = i64::try_from(index).ok().and_then(|index| index.checked_add(by));
        match index.and_then(|index| usize::try_from(index).ok()).map(|index| partition.get(index)).transpose()? {
            Some(Some(member)) => evaluate(output, &member, run),
            _ => Ok(Some(default.clone())),
        }
    })
}
