//! Cursors: the answers to queries, document by document.

use super::arguments::Arguments;
use super::document::given;
use super::failure::Failure;
use super::function::{Function, function};
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::engine::table::Thing;

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["rm-cursor-more", "robmem-cursor-more", "mongodb-cursor-more"], 1, 1, more),
    function(&["rm-cursor-next", "robmem-cursor-next", "mongodb-cursor-next"], 1, 1, next),
    function(&["rm-cursor-destroy", "robmem-cursor-destroy", "mongodb-cursor-destroy"], 1, 1, destroy),
];

const CURSOR: &str = "cursor (external address)";

fn more(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let address = arguments.address(1, CURSOR)?;
    let mut table = state.table.borrow_mut();
    let cursor = table.cursor(address).map_err(Failure::wrong)?;
    Ok(Value::truth(!cursor.is_empty()))
}

/// A document, or FALSE at the end.
fn next(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let address = arguments.address(1, CURSOR)?;
    let document = state.table.borrow_mut().cursor(address).map_err(Failure::wrong)?.pop_front();
    Ok(document.map_or(Value::truth(false), |document| given(state, Thing::Document(document))))
}

fn destroy(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let address = arguments.address(1, CURSOR)?;
    let mut table = state.table.borrow_mut();
    table.cursor(address).map_err(Failure::wrong)?;
    Ok(Value::truth(table.remove(address)))
}
