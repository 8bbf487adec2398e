//! Triggers: changes of the memory as facts.

use super::arguments::Arguments;
use super::document::given;
use super::failure::Failure;
use super::function::{Function, function};
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::engine::table::Thing;

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["rm-trigger-register", "robmem-trigger-register"], 3, 3, register),
    function(&["rm-trigger-destroy", "robmem-trigger-destroy"], 1, 1, destroy),
];

/// Returns the address of the trigger, and tells rules that wait for it, as those of Fawkes' executive do.
fn register(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let (ns, filter) = (arguments.namespace(1)?, arguments.document(2, state)?);
    let number = state.subscribe_trigger(&ns, filter, arguments.text(3)?.to_owned()).map_err(Failure::declined)?;
    state.follows(&ns);
    let trigger = given(state, Thing::Trigger(number));
    let done = [Value::Symbol("SUCCESS".to_owned()), Value::Text(arguments.text(3)?.to_owned()), trigger.clone()];
    clips.assert_mentioned("mutex-trigger-register-feedback", &done);
    Ok(trigger)
}

fn destroy(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let address = arguments.address(1, "trigger (external address)")?;
    let number = state.table.borrow_mut().trigger(address).map_err(Failure::wrong)?;
    state.forget_trigger(number);
    Ok(Value::truth(state.table.borrow_mut().remove(address)))
}
