//! The functions that programs of CLIPS have besides its own, one file per kind of thing.
//!
//! Wrong arguments, and addresses of what was destroyed, end the evaluation, as in CLIPS' own
//! functions. What can go wrong at any time (a store that is not reached, a key that is taken, a
//! text that is no query) is printed on `stderr`, and the function returns FALSE.

mod arguments;
mod asynchronous;
mod clips;
mod configuration;
mod cursor;
mod document;
mod dump;
mod executive;
mod fact;
mod failure;
mod file;
mod function;
mod lock;
mod operation;
mod pipeline;
mod problem;
mod refbox;
mod synced;
mod trigger;

use std::rc::Rc;

use super::native::{Running, Value};
use super::state::State;
use arguments::Arguments;
use failure::Failure;
use function::Function;

/// All functions, file by file.
fn all() -> impl Iterator<Item = &'static Function> {
    let groups = [
        document::FUNCTIONS,
        operation::FUNCTIONS,
        cursor::FUNCTIONS,
        fact::FUNCTIONS,
        trigger::FUNCTIONS,
        lock::FUNCTIONS,
        asynchronous::FUNCTIONS,
        pipeline::FUNCTIONS,
        refbox::FUNCTIONS,
        executive::FUNCTIONS,
        clips::FUNCTIONS,
        file::FUNCTIONS,
        configuration::FUNCTIONS,
        dump::FUNCTIONS,
        problem::FUNCTIONS,
        synced::FUNCTIONS,
    ];
    groups.into_iter().flatten()
}

/// Makes all functions known but those that a program replaces by its own.
///
/// # Errors
/// Where CLIPS has one of their names already.
pub(super) fn define<'m: 'h, 'h>(
    engine: &mut Running<'h>,
    state: &Rc<State<'m>>,
    is_replaced: &dyn Fn(&str) -> bool,
) -> Result<(), String> {
    for name in clips::LENGTHS.iter().filter(|name| !is_replaced(&name.to_string_lossy())) {
        engine.define_length(name)?;
    }
    for function in all() {
        for name in function.names.iter().filter(|name| !is_replaced(name)) {
            let state = Rc::clone(state);
            engine.define(name, function.least, function.most, move |clips, values| {
                match (function.body)(&state, clips, Arguments::new(values)) {
                    Ok(value) => Ok(value),
                    Err(Failure::CallError(error)) => Err(error),
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

/// Whether there is a function of this name.
pub(super) fn is_defined(name: &str) -> bool {
    all().any(|function| function.names.contains(&name))
        || clips::LENGTHS.iter().any(|length| length.to_bytes() == name.as_bytes())
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
