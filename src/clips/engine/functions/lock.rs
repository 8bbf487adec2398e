//! Mutual exclusion between robots, by the names of Fawkes.

use std::time::Duration;

use bson::doc;

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Function, function};
use super::operation;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::memory::lock::{Mutex, Tried};
use crate::saturate::to_i64;
use crate::store::{Index, StoreError, UpdateRequest, UpdateSpec};

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["robmem-mutex-create"], 1, 1, create),
    function(&["robmem-mutex-destroy"], 1, 1, destroy),
    function(&["robmem-mutex-try-lock"], 2, 2, |state, _, arguments| lock(state, arguments, false)),
    function(&["robmem-mutex-renew-lock"], 2, 2, |state, _, arguments| lock(state, arguments, true)),
    function(&["robmem-mutex-force-lock"], 2, 2, force),
    function(&["robmem-mutex-unlock"], 2, 2, unlock),
    function(&["robmem-mutex-setup-ttl"], 1, 1, setup),
    function(&["robmem-mutex-expire-locks"], 1, 1, expire),
];

fn mutex(state: &State<'_>, arguments: Arguments<'_>) -> Result<Mutex, Failure> {
    let owner = arguments.get(2).map(|_| arguments.text(2)).transpose()?.unwrap_or_default();
    Ok(Mutex { namespace: state.mutexes(), name: arguments.text(1)?.to_owned(), owner: owner.to_owned() })
}

pub(super) fn create(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let mutex = mutex(state, arguments)?;
    match state.memory.insert(&mutex.namespace, vec![doc! { "_id": &mutex.name, "locked": false }]) {
        // It exists already.
        Ok(_) | Err(StoreError::Duplicate { .. }) => Ok(Value::truth(true)),
        Err(error) => Err(Failure::declined(error)),
    }
}

pub(super) fn destroy(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let mutex = mutex(state, arguments)?;
    let deleted = state.memory.delete(&mutex.namespace, &doc! { "_id": &mutex.name }, true);
    Ok(Value::truth(deleted.map_err(Failure::declined)? > 0))
}

/// To renew is to lock again what one has.
pub(super) fn lock(state: &State<'_>, arguments: Arguments<'_>, again: bool) -> Result<Value, Failure> {
    let mutex = mutex(state, arguments)?;
    if again {
        let mine = doc! { "_id": &mutex.name, "locked": true, "locked-by": &mutex.owner };
        if state.memory.count(&mutex.namespace, &mine).map_err(Failure::declined)? == 0 {
            return Ok(Value::truth(false));
        }
    }
    let tried = mutex.try_lock(state.memory, None).map_err(Failure::declined)?;
    Ok(Value::truth(matches!(tried, Tried::Done(_))))
}

/// Locks it whichever owner has it.
pub(super) fn force(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let mutex = mutex(state, arguments)?;
    let mine = doc! { "locked": true, "locked-by": { "$literal": &mutex.owner }, "lock-time": "$$NOW" };
    let update = UpdateSpec::Pipeline(vec![doc! { "$set": mine }, doc! { "$unset": "lock-until" }]);
    let filter = doc! { "_id": &mutex.name };
    let request = UpdateRequest { filter, update, upsert: true, ..UpdateRequest::default() };
    state.memory.update(&mutex.namespace, &request).map_err(Failure::declined)?;
    Ok(Value::truth(true))
}

pub(super) fn unlock(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let tried = mutex(state, arguments)?.unlock(state.memory).map_err(Failure::declined)?;
    Ok(Value::truth(matches!(tried, Tried::Done(_))))
}

/// Lets mutexes expire so many seconds after they were locked.
fn setup(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let index = Index { expire_after: Some(arguments.integer(1)?), ..Index::on(doc! { "lock-time": 1 }) };
    let made = state.memory.create_index(&state.mutexes(), &index);
    made.map(|_| Value::truth(true)).map_err(Failure::declined)
}

/// Frees mutexes that were locked longer ago than so many seconds; returns how many.
pub(super) fn expire(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let age = Duration::from_secs(u64::try_from(arguments.integer(1)?).unwrap_or_default());
    let age = to_i64(age.as_millis());
    let filter = doc! { "locked": true, "$expr": { "$lte": ["$lock-time", { "$subtract": ["$$NOW", age] }] } };
    let free = doc! { "$set": { "locked": false }, "$unset": { "locked-by": 1, "lock-time": 1, "lock-until": 1 } };
    let update = UpdateSpec::Document(free);
    let request = UpdateRequest { filter, update, many: true, ..UpdateRequest::default() };
    let updated = state.memory.update(&state.mutexes(), &request).map_err(Failure::declined)?;
    Ok(operation::number(updated.modified))
}
