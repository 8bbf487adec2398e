//! The functions that programs of CLIPS have besides its own, one file per kind of thing.
//!
//! Wrong arguments, and addresses of what was destroyed, end the evaluation, as in CLIPS' own
//! functions. What can go wrong at any time (a store that is not reached, a key that is taken, a
//! text that is no query) is said on `stderr`, and the function gives FALSE.

mod arguments;
mod cursor;
mod document;
mod dump;
mod fact;
mod lock;
mod operation;
mod problem;
mod synced;
mod trigger;

use std::rc::Rc;

use super::native::{CallError, Environment, Running, Value};
use super::state::State;
use arguments::Arguments;

/// A function: all its names, its least and greatest number of arguments, and what it does.
struct Function {
    names: &'static [&'static str],
    least: u16,
    most: Option<u16>,
    body: Body,
}

type Body = for<'s> fn(&'s State<'_>, &'s Environment, Arguments<'s>) -> Result<Value, Failure>;

const fn function(names: &'static [&'static str], least: u16, most: u16, body: Body) -> Function {
    Function { names, least, most: Some(most), body }
}

const fn open(names: &'static [&'static str], least: u16, body: Body) -> Function {
    Function { names, least, most: None, body }
}

/// Why a function has no value.
enum Failure {
    /// The program is wrong; the evaluation ends.
    CallError(CallError),
    /// It was not possible; the function gives FALSE.
    Declined(String),
}

impl From<CallError> for Failure {
    fn from(trouble: CallError) -> Self {
        Self::CallError(trouble)
    }
}

impl Failure {
    /// It was not possible.
    fn declined(error: impl std::fmt::Display) -> Self {
        Self::Declined(error.to_string())
    }

    /// It was not possible, for reasons that have reasons.
    fn chained(error: &anyhow::Error) -> Self {
        Self::Declined(format!("{error:#}"))
    }

    /// The program is wrong.
    fn wrong(message: impl Into<String>) -> Self {
        Self::CallError(CallError::Failed(message.into()))
    }
}

/// All functions, file by file.
fn all() -> impl Iterator<Item = &'static Function> {
    let rooms = [
        document::FUNCTIONS,
        operation::FUNCTIONS,
        cursor::FUNCTIONS,
        fact::FUNCTIONS,
        trigger::FUNCTIONS,
        lock::FUNCTIONS,
        dump::FUNCTIONS,
        problem::FUNCTIONS,
        synced::FUNCTIONS,
    ];
    rooms.into_iter().flatten()
}

/// Makes all functions known.
pub(super) fn define<'m: 'h, 'h>(clips: &mut Running<'h>, state: &Rc<State<'m>>) -> Result<(), String> {
    for function in all() {
        for name in function.names {
            let state = Rc::clone(state);
            clips.define(name, function.least, function.most, move |clips, values| {
                match (function.body)(&state, clips, Arguments::new(values)) {
                    Ok(value) => Ok(value),
                    Err(Failure::CallError(trouble)) => Err(trouble),
                    Err(Failure::Declined(message)) => {
                        clips.complain(&format!("[RMEM5] Function '{name}': {message}"));
                        Ok(Value::truth(false))
                    }
                }
            })?;
        }
    }
    Ok(())
}

/// Returns the names of all functions.
#[cfg(test)]
pub(crate) fn names() -> Vec<&'static str> {
    all().flat_map(|function| function.names).copied().collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn no_name_is_given_twice() {
        let mut names = super::names();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
    }
}
