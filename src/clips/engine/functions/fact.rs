//! Facts as documents, and documents as facts.

use super::arguments::Arguments;
use super::document::given;
use super::failure::Failure;
use super::function::{Function, function};
use crate::clips::engine::exchange;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::engine::table::Thing;
use crate::clips::facts::RELATION;

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["rm-fact-to-bson", "rm-structured-fact-to-bson"], 1, 2, to_document),
    function(&["rm-ordered-fact-to-bson"], 1, 1, to_document),
    function(&["rm-assert-from-bson"], 1, 1, assert),
];

/// `(rm-fact-to-bson FACT [RELATION])`; the document has the relation of the fact's template, or this one.
fn to_document(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let fact = arguments.fact(1)?;
    if !clips.exists(fact) {
        return Err(Failure::wrong("the fact is gone"));
    }
    let mut document = exchange::document(fact, clips, &mut state.table.borrow_mut()).map_err(Failure::Declined)?;
    if arguments.get(2).is_some() {
        document.insert(RELATION, arguments.text(2)?);
    }
    Ok(given(state, Thing::Document(document)))
}

/// Returns the fact.
fn assert(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let document = arguments.document(1, state)?;
    let name = document.get_str(RELATION).unwrap_or_default();
    let schema = exchange::schema(clips, [name]);
    let fact = exchange::exported(&document, &schema).map_err(Failure::Declined)?;
    exchange::assert(&fact, clips).map(Value::Fact).map_err(Failure::Declined)
}
