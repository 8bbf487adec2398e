//! The world model that executives (CX) keep in common, by the names of its functions there.

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Function, function, open};
use super::operation;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::engine::wm_facts::{TEMPLATE, key};

pub(super) const FUNCTIONS: &[Function] = &[
    open(&["wm-robmem-sync-enable"], 1, enable),
    function(&["wm-robmem-sync-restore"], 0, 0, |state, clips, _| {
        let prefixes = state.wm_facts.prefixes.borrow().clone();
        prefixes.iter().try_fold(0, |sum, prefix| Ok(sum + restore(prefix, state, clips)?)).map(operation::number)
    }),
    function(&["wm-robmem-sync-restore-prefix"], 1, 1, |state, clips, arguments| {
        restore(&key(arguments.text(1)?), state, clips).map(operation::number)
    }),
    function(&["ff-feature-request"], 1, 1, request),
    function(&["wm-robmem-flush"], 0, 0, |state, _, _| {
        state.wm_facts.flush(state).map(operation::number).map_err(|error| Failure::chained(&error))
    }),
];

fn restore(prefix: &[String], state: &State<'_>, clips: &Environment) -> Result<u64, Failure> {
    state.wm_facts.restore(prefix, state, clips).map_err(|error| Failure::chained(&error))
}

/// The features of Fawkes whose functions are always there.
const FEATURES: [&str; 3] = ["config", "redefine-warning", "robot_memory"];

/// `(ff-feature-request NAME)`: as in Fawkes, TRUE and a fact `(ff-feature-loaded NAME)` for a feature that is there.
fn request(_: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let name = arguments.text(1)?;
    if !FEATURES.contains(&name) {
        let known = FEATURES.join(", ");
        let message = format!("there is no feature {name}, only {known}; define its functions in a file of your own");
        return Err(Failure::Declined(message));
    }
    clips.assert_text(&format!("(ff-feature-loaded {name})"));
    Ok(Value::truth(true))
}

/// `(wm-robmem-sync-enable PREFIX…)`
fn enable(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    if clips.template(TEMPLATE).is_none() {
        return Err(Failure::Declined(format!("there is no deftemplate `{TEMPLATE}`")));
    }
    for prefix in arguments.rest(1) {
        let (Value::Text(prefix) | Value::Symbol(prefix)) = prefix else {
            return Err(Failure::wrong("expected prefixes of ids, like \"/domain/\""));
        };
        state.wm_facts.enable(prefix, state).map_err(|error| Failure::chained(&error))?;
    }
    Ok(Value::truth(true))
}
