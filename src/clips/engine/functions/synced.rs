//! Facts of the shared world model.

use std::time::{Duration, Instant};

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Function, function, open};
use crate::clips::engine::native::{CallError, Environment, FactRef, Value};
use crate::clips::engine::state::State;
use crate::clips::engine::world::{Modified, sync_id};

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["synced-assert"], 1, 1, assert),
    open(&["synced-modify"], 3, modify),
    function(&["synced-retract"], 1, 1, retract),
    function(&["synced-add-to-multifield"], 3, 3, |state, clips, arguments| several(state, clips, arguments, true)),
    function(&["synced-remove-from-multifield"], 3, 3, |state, clips, arguments| {
        several(state, clips, arguments, false)
    }),
];

/// How long one tries where another engine changes the same slot all the time.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);

fn begin(state: &State<'_>, clips: &Environment) -> Result<(), Failure> {
    state.world.start(state, clips).map_err(|error| Failure::chained(&error))
}

/// Returns the fact.
fn assert(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    begin(state, clips)?;
    let text = arguments.text(1)?;
    state.world.assert(text, state, clips).map(Value::Fact).map_err(Failure::Declined)
}

/// Returns the fact as it is then, or FALSE where another engine has retracted it.
fn modify(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    begin(state, clips)?;
    let fact = arguments.fact(1)?;
    let mut changes = Vec::new();
    let mut nth = 2;
    while arguments.get(nth).is_some() {
        let value = arguments
            .get(nth + 1)
            .ok_or(CallError::Failed(format!("expected a value for the slot `{}`", arguments.text(nth)?)))?;
        changes.push((arguments.text(nth)?.to_owned(), value.clone()));
        nth += 2;
    }
    match state.world.modify(fact, &changes, false, state, clips).map_err(Failure::Declined)? {
        Modified::Fact(fact) => Ok(Value::Fact(fact)),
        Modified::Gone | Modified::Differs => Ok(Value::truth(false)),
    }
}

fn retract(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    begin(state, clips)?;
    state.world.retract(arguments.fact(1)?, state, clips).map(|()| Value::truth(true)).map_err(Failure::Declined)
}

/// Adds a value at the end, or removes all that are equal, whatever others do to the slot meanwhile.
fn several(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>, add: bool) -> Result<Value, Failure> {
    begin(state, clips)?;
    let (slot, given) = (arguments.text(2)?, arguments.rest(3));
    let mut fact: FactRef = arguments.fact(1)?.clone();
    let id = sync_id(&fact, clips).ok_or_else(|| Failure::wrong("the fact has no `sync-id`"))?;
    let start = Instant::now();
    loop {
        let found = clips.slots(&fact).into_iter().find(|(name, _)| name == slot);
        let Some((_, Value::Many(mut values))) = found else {
            return Err(Failure::wrong(format!("the fact has no multislot `{slot}`")));
        };
        let count = values.len();
        match add {
            true => values.extend(given.iter().map(|value| (*value).clone())),
            false => values.retain(|value| !given.contains(&value)),
        }
        if !add && values.len() == count {
            return Ok(Value::Fact(fact));
        }
        let change = [(slot.to_owned(), Value::Many(values))];
        match state.world.modify(&fact, &change, true, state, clips).map_err(Failure::Declined)? {
            Modified::Fact(fact) => return Ok(Value::Fact(fact)),
            Modified::Gone => return Ok(Value::truth(false)),
            Modified::Differs if start.elapsed() > ANSWER_TIMEOUT || state.stop().is_due() => {
                return Err(Failure::Declined(format!("the slot `{slot}` is changed by others all the time")));
            }
            Modified::Differs => {}
        }
        // What the others did is on its way.
        state.receive(clips, true).map_err(|error| Failure::chained(&error))?;
        match state.world.current(id, clips) {
            Some(current) => fact = current,
            None => return Ok(Value::truth(false)),
        }
    }
}
