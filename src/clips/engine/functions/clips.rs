//! Functions that programs of Fawkes, and of CLIPS 6.30, expect besides those of the memory.

use std::ffi::CStr;

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Function, function};
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::facts;
use crate::saturate::to_i64;

pub(super) const FUNCTIONS: &[Function] = &[function(&["now", "now-systime"], 0, 0, now)];

/// `length`, and `length$` in place of that of CLIPS.
pub(super) const LENGTHS: [&CStr; 2] = [c"length", c"length$"];

/// The time as seconds and microseconds since 1970.
fn now(_: &State<'_>, _: &Environment, _: Arguments<'_>) -> Result<Value, Failure> {
    let now = facts::now();
    let seconds = to_i64(now.as_secs());
    Ok(Value::Many(vec![Value::Integer(seconds), Value::Integer(i64::from(now.subsec_micros()))]))
}
