//! The memory's operations as the referee box of the RoboCup Logistics League has them: a collection without a database
//! is one of the database of `--collection`.

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Body, Function, function};
use super::operation::{Replacement, change, insert, query};
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["mongodb-insert"], 2, 2, |state, clips, arguments| within(insert, state, clips, arguments)),
    function(&["mongodb-query"], 2, 2, |state, clips, arguments| within(query, state, clips, arguments)),
    function(&["mongodb-query-sort"], 3, 3, |state, clips, arguments| within(query, state, clips, arguments)),
    function(&["mongodb-update", "mongodb-replace"], 3, 3, |state, clips, arguments| {
        within(|state, _, arguments| change(state, arguments, Replacement::Set), state, clips, arguments)
    }),
    function(&["mongodb-upsert"], 3, 3, |state, clips, arguments| {
        within(|state, _, arguments| change(state, arguments, Replacement::SetOrInsert), state, clips, arguments)
    }),
];

/// Calls a function whose first argument is a namespace.
fn within(body: Body, state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let name = arguments.text(1)?;
    if name.contains('.') {
        return body(state, clips, arguments);
    }
    let mut values = arguments.values().to_vec();
    if let Some(first) = values.first_mut() {
        *first = Value::Text(format!("{}.{name}", state.job.collection.database));
    }
    body(state, clips, Arguments::new(&values))
}
