//! Facts as documents, and documents as facts.

use super::arguments::Arguments;
use super::document::given;
use super::failure::Failure;
use super::function::{Function, function};
use crate::clips::engine::exchange;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::engine::table::Thing;

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["rm-fact-to-bson", "rm-structured-fact-to-bson", "rm-ordered-fact-to-bson"], 1, 1, to_document),
    function(&["rm-assert-from-bson"], 1, 1, assert),
];

fn to_document(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let fact = arguments.fact(1)?;
    if !clips.exists(fact) {
        return Err(Failure::wrong("the fact is gone"));
    }
    let document = exchange::document(fact, clips, &mut state.table.borrow_mut()).map_err(Failure::Declined)?;
    Ok(given(state, Thing::Document(document)))
}

/// Returns the fact.
fn assert(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let document = arguments.document(1, state)?;
    let name = document.get_str(crate::clips::facts::RELATION).unwrap_or_default();
    let schema = exchange::schema(clips, [name]);
    let fact = exchange::exported(&document, &schema).map_err(Failure::Declined)?;
    exchange::assert(&fact, clips).map(Value::Fact).map_err(Failure::Declined)
}
