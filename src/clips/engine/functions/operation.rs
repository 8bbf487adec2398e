//! The memory's operations.

use bson::{Bson, Document, doc};

use super::arguments::Arguments;
use super::document::given;
use super::failure::Failure;
use super::function::{Function, function};
use crate::clips::engine::exchange;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::engine::table::Thing;
use crate::query::QueryError;
use crate::saturate::to_i64;
use crate::store::{Find, Index, UpdateRequest, UpdateSpec};

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["rm-insert", "robmem-insert"], 2, 2, insert),
    function(&["rm-query", "robmem-query"], 1, 3, query),
    function(&["rm-query-sort", "robmem-query-sort"], 3, 3, query),
    function(&["rm-count", "robmem-count"], 1, 2, count),
    function(&["rm-update", "robmem-update"], 3, 3, |state, _, arguments| change(state, arguments, Replacement::Set)),
    function(&["rm-replace", "robmem-replace"], 3, 3, |state, _, arguments| {
        change(state, arguments, Replacement::Replace)
    }),
    function(&["rm-upsert", "robmem-upsert"], 3, 3, |state, _, arguments| {
        change(state, arguments, Replacement::Upsert)
    }),
    function(&["rm-delete", "rm-remove", "robmem-remove"], 2, 2, delete),
    function(&["rm-create-index", "robmem-create-index"], 2, 2, |state, _, arguments| index(state, arguments, false)),
    function(&["rm-create-unique-index", "robmem-create-unique-index"], 2, 2, |state, _, arguments| {
        index(state, arguments, true)
    }),
];

/// Returns the `_id`.
pub(super) fn insert(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let (ns, document) = (arguments.namespace(1)?, arguments.document(2, state)?);
    let inserted = state.memory.insert(&ns, vec![document]).map_err(Failure::declined)?;
    let id = inserted.ids.first().unwrap_or(&Bson::Null);
    Ok(exchange::to_value(id, &mut state.table.borrow_mut()))
}

/// Gives a cursor.
pub(super) fn query(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let ns = arguments.namespace(1)?;
    let optional = |nth: u32| arguments.get(nth).map(|_| arguments.document(nth, state)).transpose();
    let find =
        Find { filter: optional(2)?.unwrap_or_default(), sort: optional(3)?.unwrap_or_default(), ..Find::default() };
    let found = state.memory.find(&ns, &find).map_err(Failure::declined)?;
    let owned = found.map(|document| {
        let document = document.map_err(Failure::declined)?;
        Document::try_from(&*document).map_err(|error| Failure::declined(QueryError::from(error)))
    });
    Ok(given(state, Thing::Cursor(owned.collect::<Result<_, _>>()?)))
}

fn count(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let ns = arguments.namespace(1)?;
    let filter = arguments.get(2).map(|_| arguments.document(2, state)).transpose()?.unwrap_or_default();
    let count = state.memory.count(&ns, &filter).map_err(Failure::declined)?;
    Ok(number(count))
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Replacement {
    Set,
    Replace,
    Upsert,
    SetOrInsert,
}

/// Changes the first match; returns how many there were, with an upsert always 1.
pub(super) fn change(state: &State<'_>, arguments: Arguments<'_>, replacement: Replacement) -> Result<Value, Failure> {
    let ns = arguments.namespace(1)?;
    let (document, filter) = (arguments.document(2, state)?, arguments.document(3, state)?);
    let has_operators = document.keys().next().is_some_and(|key| key.starts_with('$'));
    let update = match replacement {
        Replacement::Set | Replacement::SetOrInsert if !has_operators => doc! { "$set": document },
        _ => document,
    };
    let upsert = matches!(replacement, Replacement::Upsert | Replacement::SetOrInsert);
    let request = UpdateRequest { filter, update: UpdateSpec::Document(update), upsert, ..UpdateRequest::default() };
    let updated = state.memory.update(&ns, &request).map_err(Failure::declined)?;
    Ok(number(updated.matched + u64::from(updated.upserted.is_some())))
}

/// Removes all matches; returns how many.
fn delete(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let (ns, filter) = (arguments.namespace(1)?, arguments.document(2, state)?);
    Ok(number(state.memory.delete(&ns, &filter, false).map_err(Failure::declined)?))
}

fn index(state: &State<'_>, arguments: Arguments<'_>, unique: bool) -> Result<Value, Failure> {
    let (ns, keys) = (arguments.namespace(1)?, arguments.document(2, state)?);
    let index = Index { unique, ..Index::on(keys) };
    let made = state.memory.create_index(&ns, &index);
    made.map(|_| Value::truth(true)).map_err(Failure::declined)
}

/// A count.
pub(super) fn number(count: u64) -> Value {
    Value::Integer(to_i64(count))
}
