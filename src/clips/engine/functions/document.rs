//! Documents: made, read, and changed in place.

use bson::{Bson, DateTime, Document, Regex};

use super::arguments::{Arguments, parse};
use super::failure::Failure;
use super::function::{Function, function, open};
use crate::clips::engine::exchange;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::engine::table::Thing;
use crate::formats::shell;

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["bson-create"], 0, 0, |state, _, _| Ok(given(state, Thing::Document(Document::new())))),
    function(&["bson-parse"], 1, 1, read),
    function(&["bson-destroy", "bson-builder-destroy"], 1, 1, destroy),
    function(&["bson-tostring"], 1, 1, write),
    function(&["bson-append"], 3, 3, append),
    open(&["bson-append-array"], 2, append_array),
    function(&["bson-append-time"], 3, 3, append_time),
    function(&["bson-append-regex"], 3, 3, append_regex),
    function(&["bson-array-start"], 0, 0, |state, _, _| Ok(given(state, Thing::Array(Vec::new())))),
    function(&["bson-array-append"], 2, 2, array_append),
    function(&["bson-array-finish"], 3, 3, array_finish),
    function(&["bson-field-names"], 1, 1, names),
    function(&["bson-has-field"], 2, 2, has),
    function(&["bson-get"], 2, 2, get),
    function(&["bson-get-array"], 2, 2, get_array),
    function(&["bson-get-time"], 2, 2, get_time),
];

/// The address of a new thing.
pub(super) fn given(state: &State<'_>, thing: Thing) -> Value {
    Value::Address(state.table.borrow_mut().add(thing))
}

const DOCUMENT: &str = "document (external address)";

/// Does something with the document of the first argument.
fn with<T>(
    state: &State<'_>,
    arguments: Arguments<'_>,
    work: impl FnOnce(&mut Document) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let address = arguments.address(1, DOCUMENT)?;
    let mut table = state.table.borrow_mut();
    work(table.document(address).map_err(Failure::wrong)?)
}

/// As in Fawkes, a text that is not a document gives an empty one, with a message.
fn read(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let document = match parse(arguments.text(1)?) {
        Err(Failure::Declined(message)) => {
            clips.complain(&format!("[RMEM5] Function 'bson-parse': {message}"));
            Document::new()
        }
        parsed => parsed?,
    };
    Ok(given(state, Thing::Document(document)))
}

fn destroy(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let address = arguments.address(1, DOCUMENT)?;
    with(state, arguments, |_| Ok(()))?;
    Ok(Value::truth(state.table.borrow_mut().remove(address)))
}

fn write(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    with(state, arguments, |document| Ok(Value::Text(shell::relaxed(document))))
}

/// Puts a value at a key, in place of what is there.
fn put(state: &State<'_>, arguments: Arguments<'_>, value: Bson) -> Result<Value, Failure> {
    let key = arguments.text(2)?;
    with(state, arguments, |document| {
        document.insert(key, value);
        Ok(Value::truth(true))
    })
}

fn append(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    put(state, arguments, arguments.value(3, state)?)
}

fn append_array(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let values = arguments.rest(3).into_iter();
    let values: Vec<Bson> = {
        let mut table = state.table.borrow_mut();
        values.map(|value| exchange::to_bson(value, &mut table)).collect::<Result<_, _>>().map_err(Failure::wrong)?
    };
    put(state, arguments, Bson::Array(values))
}

fn append_time(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let whole: Vec<i64> = arguments
        .rest(3)
        .iter()
        .filter_map(|value| match value {
            Value::Integer(number) => Some(*number),
            _ => None,
        })
        .collect();
    let [seconds, microseconds] = whole.as_slice() else {
        return Err(
            crate::clips::engine::native::CallError::Argument(3, "multifield of seconds and microseconds").into()
        );
    };
    let date = DateTime::from_millis(seconds.saturating_mul(1_000).saturating_add(microseconds / 1_000));
    put(state, arguments, date.into())
}

fn append_regex(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let pattern = arguments.text(3)?.try_into().map_err(|_| Failure::wrong("a pattern has no NUL"))?;
    let options = "".try_into().map_err(|_| Failure::wrong("a pattern has no NUL"))?;
    put(state, arguments, Bson::RegularExpression(Regex { pattern, options }))
}

fn array_append(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let address = arguments.address(1, "array (external address)")?;
    let value = arguments.value(2, state)?;
    state.table.borrow_mut().array(address).map_err(Failure::wrong)?.push(value);
    Ok(Value::truth(true))
}

fn array_finish(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let address = arguments.address(3, "array (external address)")?;
    let values = std::mem::take(state.table.borrow_mut().array(address).map_err(Failure::wrong)?);
    let put = put(state, arguments, Bson::Array(values))?;
    state.table.borrow_mut().remove(address);
    Ok(put)
}

fn names(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    with(state, arguments, |document| Ok(Value::Many(document.keys().map(|key| Value::Text(key.clone())).collect())))
}

/// The value at a dotted path; a number is a place in an array, or a key.
fn at(document: &Document, path: &str) -> Option<Bson> {
    if let Some(value) = document.get(path) {
        return Some(value.clone());
    }
    let mut names = path.split('.');
    let first = document.get(names.next()?)?;
    names
        .try_fold(first, |value, name| match value {
            Bson::Document(document) => document.get(name),
            Bson::Array(values) => values.get(name.parse::<usize>().ok()?),
            _ => None,
        })
        .cloned()
}

fn value(state: &State<'_>, arguments: Arguments<'_>) -> Result<Option<Bson>, Failure> {
    let path = arguments.text(2)?;
    with(state, arguments, |document| Ok(at(document, path)))
}

fn missing(arguments: Arguments<'_>) -> Failure {
    Failure::Declined(format!("the document has no `{}`", arguments.text(2).unwrap_or_default()))
}

fn has(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    Ok(Value::truth(value(state, arguments)?.is_some()))
}

fn get(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let value = value(state, arguments)?.ok_or_else(|| missing(arguments))?;
    Ok(exchange::to_value(&value, &mut state.table.borrow_mut()))
}

fn get_array(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    match value(state, arguments)?.ok_or_else(|| missing(arguments))? {
        array @ Bson::Array(_) => Ok(exchange::to_value(&array, &mut state.table.borrow_mut())),
        _ => Err(Failure::Declined(format!("`{}` is not an array", arguments.text(2)?))),
    }
}

fn get_time(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    match value(state, arguments)?.ok_or_else(|| missing(arguments))? {
        Bson::DateTime(date) => Ok(exchange::time(date.timestamp_millis())),
        Bson::Timestamp(time) => Ok(exchange::time(i64::from(time.time) * 1_000)),
        _ => Err(Failure::Declined(format!("`{}` is not a date", arguments.text(2)?))),
    }
}
