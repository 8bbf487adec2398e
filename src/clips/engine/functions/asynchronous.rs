//! Mutual exclusion as Fawkes' executive asks for it: the result comes as a fact.
//!
//! In Fawkes these functions return while the store is still at work. Here the work is done when they return, and
//! the facts are asserted as there: `(mutex-op-feedback OPERATION OK|FAIL NAME)`.

use super::failure::Failure;
use super::function::{Function, function};
use super::lock;
use crate::clips::engine::exchange;
use crate::clips::engine::native::{Environment, Value};
use crate::formats::Span;
use crate::formats::clips::{self, Body, Fact, is_symbol};

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["robmem-mutex-create-async"], 1, 1, |state, clips, arguments| {
        started(lock::create(state, clips, arguments), clips, "create")
    }),
    function(&["robmem-mutex-destroy-async"], 1, 1, |state, clips, arguments| {
        started(lock::destroy(state, clips, arguments), clips, "destroy")
    }),
    function(&["robmem-mutex-try-lock-async"], 2, 2, |state, clips, arguments| {
        // Of success the agent learns by the change of the mutex' document.
        let is_locked = succeeded(lock::lock(state, arguments, false), clips, "try-lock")?;
        if !is_locked {
            assert_feedback("try-lock-async", false, Some(arguments.text(1)?), clips)?;
        }
        Ok(begun())
    }),
    function(&["robmem-mutex-renew-lock-async"], 2, 2, |state, clips, arguments| {
        let is_renewed = succeeded(lock::lock(state, arguments, true), clips, "renew-lock")?;
        assert_feedback("renew-lock-async", is_renewed, Some(arguments.text(1)?), clips)?;
        Ok(begun())
    }),
    function(&["robmem-mutex-force-lock-async"], 2, 2, |state, clips, arguments| {
        started(lock::force(state, clips, arguments), clips, "force-lock")
    }),
    function(&["robmem-mutex-unlock-async"], 2, 2, |state, clips, arguments| {
        started(lock::unlock(state, clips, arguments), clips, "unlock")
    }),
    function(&["robmem-mutex-expire-locks-async"], 1, 1, |state, clips, arguments| {
        let is_done = match lock::expire(state, clips, arguments) {
            Err(Failure::Declined(message)) => declined(clips, "expire-locks", &message),
            done => done.map(|_| true)?,
        };
        assert_feedback("expire-locks-async", is_done, None, clips)?;
        Ok(Value::truth(true))
    }),
];

/// What these functions return: that the work began.
fn begun() -> Value {
    Value::Many(vec![Value::truth(true)])
}

fn started(done: Result<Value, Failure>, clips: &Environment, operation: &str) -> Result<Value, Failure> {
    succeeded(done, clips, operation).map(|_| begun())
}

/// Whether an operation succeeded; where the store failed, that is printed.
fn succeeded(done: Result<Value, Failure>, clips: &Environment, operation: &str) -> Result<bool, Failure> {
    match done {
        Err(Failure::Declined(message)) => Ok(declined(clips, operation, &message)),
        done => Ok(done? == Value::truth(true)),
    }
}

fn declined(clips: &Environment, operation: &str, message: &str) -> bool {
    clips.complain(&format!("[RMEM5] Function 'robmem-mutex-{operation}-async': {message}"));
    false
}

/// Asserts the fact `mutex-op-feedback` with the result of an operation.
fn assert_feedback(operation: &str, is_done: bool, name: Option<&str>, clips: &Environment) -> Result<(), Failure> {
    let symbol = |text: &str| clips::Value::Symbol(text.to_owned());
    let mut values = vec![symbol(operation), symbol(if is_done { "OK" } else { "FAIL" })];
    values.extend(name.map(|name| if is_symbol(name) { symbol(name) } else { clips::Value::Text(name.to_owned()) }));
    let fact = Fact { name: "mutex-op-feedback".to_owned(), body: Body::Ordered(values), span: Span::default() };
    exchange::assert(&fact, clips).map(drop).map_err(Failure::Declined)
}
