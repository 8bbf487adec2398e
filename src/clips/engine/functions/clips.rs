//! Functions that programs of Fawkes, and of CLIPS 6.30, expect besides those of the memory.

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Function, function};
use crate::clips::engine::native::{CallError, Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::facts;

pub(super) const FUNCTIONS: &[Function] =
    &[function(&["now", "now-systime"], 0, 0, now), function(&["length"], 1, 1, length)];

/// The time as seconds and microseconds since 1970.
fn now(_: &State<'_>, _: &Environment, _: Arguments<'_>) -> Result<Value, Failure> {
    let now = facts::now();
    let seconds = i64::try_from(now.as_secs()).unwrap_or(i64::MAX);
    Ok(Value::Many(vec![Value::Integer(seconds), Value::Integer(i64::from(now.subsec_micros()))]))
}

/// How many values a multifield has, or characters a text: CLIPS 6.40 has `length$` and `str-length` only.
fn length(_: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let length = match arguments.get(1) {
        Some(Value::Many(values)) => values.len(),
        Some(Value::Symbol(text) | Value::Text(text)) => text.chars().count(),
        _ => return Err(CallError::Argument(1, "string, symbol or multifield").into()),
    };
    Ok(Value::Integer(i64::try_from(length).unwrap_or(i64::MAX)))
}
