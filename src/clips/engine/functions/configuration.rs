//! The robot's configuration as facts `confval`, as Fawkes and executives (CX) have them.

use bson::{Bson, Document};

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Function, function};
use super::operation;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::robot_configuration;
use crate::clips::engine::state::State;

pub(super) const FUNCTIONS: &[Function] = &[function(&["config-load", "load-config"], 1, 2, load)];

const NAME: &str = "confval";
const TEMPLATE: &str = "(deftemplate confval
   (slot path (type STRING))
   (slot type (type SYMBOL) (allowed-values FLOAT UINT INT BOOL STRING))
   (slot value)
   (slot is-list (type SYMBOL) (allowed-values TRUE FALSE) (default FALSE))
   (multislot list-value))";

/// `(config-load PREFIX)` of the configuration, and `(config-load FILE PREFIX)` of another file.
fn load(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let (documents, prefix) = match arguments.get(2) {
        None if state.job.configuration.is_empty() => {
            return Err(Failure::Declined("there is no configuration; --values names its YAML files".to_owned()));
        }
        None => (state.job.configuration.clone(), arguments.text(1)?),
        Some(_) => {
            let read = robot_configuration::read(arguments.text(1)?);
            (read.map_err(Failure::declined)?, arguments.text(2)?)
        }
    };
    if clips.template(NAME).is_none() && (state.is_loading() || !clips.load(TEMPLATE)) {
        return Err(Failure::Declined(format!("there is no deftemplate `{NAME}`")));
    }
    let mut values = Document::new();
    documents.into_iter().for_each(|document| merge(&mut values, nested(document)));
    let mut facts = Vec::new();
    flatten("", Bson::Document(values), &mut facts);
    let prefix: Vec<&str> = parts(prefix).collect();
    let mut count = 0;
    for (path, value) in facts {
        if parts(&path).zip(&prefix).filter(|(part, wanted)| part == *wanted).count() == prefix.len() {
            let slots = slots(path, value);
            clips.assert(NAME, &slots).map_err(Failure::Declined)?;
            count += 1;
        }
    }
    Ok(operation::number(count))
}

fn parts(path: &str) -> impl DoubleEndedIterator<Item = &str> {
    path.split('/').filter(|part| !part.is_empty())
}

/// A document whose keys that are paths (`a/b: 1`) are documents in one another.
fn nested(document: Document) -> Document {
    let mut all = Document::new();
    for (key, value) in document {
        let value = match value {
            Bson::Document(inner) => Bson::Document(nested(inner)),
            value => value,
        };
        let mut names = parts(&key).rev();
        let last = names.next().unwrap_or(&key).to_owned();
        let whole = names.fold(bson::doc! { last: value }, |inner, name| bson::doc! { name: inner });
        merge(&mut all, whole);
    }
    all
}

/// Adds values; those that are there already are changed.
fn merge(values: &mut Document, more: Document) {
    for (key, value) in more {
        match (values.get_mut(&key), value) {
            (Some(Bson::Document(old)), Bson::Document(new)) => merge(old, new),
            (_, value) => drop(values.insert(key, value)),
        }
    }
}

/// The values by their paths.
fn flatten(path: &str, value: Bson, facts: &mut Vec<(String, Bson)>) {
    match value {
        Bson::Document(document) => {
            for (key, value) in document {
                flatten(&format!("{path}/{key}"), value, facts);
            }
        }
        Bson::Array(values) if values.iter().any(|value| matches!(value, Bson::Document(_) | Bson::Array(_))) => {
            for (index, value) in values.into_iter().enumerate() {
                flatten(&format!("{path}/{index}"), value, facts);
            }
        }
        Bson::Null => {}
        value => facts.push((path.to_owned(), value)),
    }
}

/// The slots of the fact of a value.
fn slots(path: String, value: Bson) -> Vec<(String, Value)> {
    let symbol = |text: &str| Value::Symbol(text.to_owned());
    let (values, is_list) = match value {
        Bson::Array(values) => (values, true),
        value => (vec![value], false),
    };
    let kinds: Vec<&str> = values.iter().map(kind).collect();
    let kind = match kinds.first() {
        Some(first) if kinds.iter().all(|kind| kind == first) => first,
        Some(_) if kinds.iter().all(|kind| ["INT", "UINT"].contains(kind)) => "INT",
        Some(_) if kinds.iter().all(|kind| ["INT", "UINT", "FLOAT"].contains(kind)) => "FLOAT",
        _ => "STRING",
    };
    let mut values: Vec<Value> = values.into_iter().map(|value| as_kind(kind, value)).collect();
    let mut slots = vec![("path".to_owned(), Value::Text(path)), ("type".to_owned(), symbol(kind))];
    if is_list {
        slots.push(("is-list".to_owned(), Value::truth(true)));
        slots.push(("list-value".to_owned(), Value::Many(values)));
    } else {
        slots.extend(values.pop().map(|value| ("value".to_owned(), value)));
    }
    slots
}

fn kind(value: &Bson) -> &'static str {
    match value {
        Bson::Int32(number) if *number < 0 => "INT",
        Bson::Int64(number) if *number < 0 => "INT",
        Bson::Int32(_) | Bson::Int64(_) => "UINT",
        Bson::Double(_) => "FLOAT",
        Bson::Boolean(_) => "BOOL",
        _ => "STRING",
    }
}

/// A value of this kind.
fn as_kind(kind: &str, value: Bson) -> Value {
    match (kind, value) {
        ("BOOL", Bson::Boolean(flag)) => Value::truth(flag),
        #[allow(clippy::cast_precision_loss, reason = "a list of numbers with a fraction among them")]
        ("FLOAT", Bson::Int64(number)) => Value::Float(number as f64),
        ("FLOAT", Bson::Int32(number)) => Value::Float(number.into()),
        ("FLOAT", Bson::Double(number)) => Value::Float(number),
        ("INT" | "UINT", Bson::Int64(number)) => Value::Integer(number),
        ("INT" | "UINT", Bson::Int32(number)) => Value::Integer(number.into()),
        (_, Bson::String(text)) => Value::Text(text),
        (_, Bson::DateTime(date)) => Value::Text(date.try_to_rfc3339_string().unwrap_or_default()),
        (_, other) => Value::Text(other.to_string()),
    }
}
