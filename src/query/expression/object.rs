//! Documents: merging, fields by name; `$type` and the like.

use bson::{Bson, Document};

use super::operator::{ANY, Arguments, Named, Operator, at, is_null, is_true, type_name, wrong_type};
use super::value::Value;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::view::View;

pub(super) const OPERATORS: [Operator; 6] = [
    Operator { name: "$mergeObjects", arity: (0, ANY), call: merged },
    Operator { name: "$type", arity: (1, 1), call: name_of_type },
    Operator { name: "$isNumber", arity: (1, 1), call: |v| Ok(Some(Bson::Boolean(Number::of(at(v, 0)).is_some()))) },
    Operator { name: "$not", arity: (1, 1), call: |v| Ok(Some(Bson::Boolean(!is_true(v.first().unwrap_or(&None))))) },
    Operator { name: "$tsSecond", arity: (1, 1), call: |v| timestamp("$tsSecond", v, |t| t.time) },
    Operator { name: "$tsIncrement", arity: (1, 1), call: |v| timestamp("$tsIncrement", v, |t| t.increment) },
];

pub(super) const NAMED: [Named; 3] = [
    Named { name: "$getField", fields: &[("field", true), ("input", true)], bare: true, call: get_field },
    Named {
        name: "$setField",
        fields: &[("field", true), ("input", true), ("value", true)],
        bare: false,
        call: set_field,
    },
    Named { name: "$unsetField", fields: &[("field", true), ("input", true)], bare: false, call: unset_field },
];

fn timestamp(operator: &str, values: &[Value], part: fn(&bson::Timestamp) -> u32) -> Result<Value> {
    match at(values, 0) {
        value if is_null(value) => Ok(Some(Bson::Null)),
        Bson::Timestamp(timestamp) => Ok(Some(Bson::Int64(part(timestamp).into()))),
        other => {
            let code = if operator == "$tsSecond" { 5_687_301 } else { 5_687_302 };
            Err(wrong_type(code, operator, "a timestamp", other))
        }
    }
}

fn name_of_type(values: &[Value]) -> Result<Value> {
    let name = values.first().and_then(Option::as_ref).map_or("missing", |value| View::from(value).type_name());
    Ok(Some(Bson::String(name.to_owned())))
}

fn merged(values: &[Value]) -> Result<Value> {
    let items: Vec<&Bson> = match values {
        [Some(Bson::Array(items))] => items.iter().collect(),
        values => values.iter().flatten().collect(),
    };
    let mut merged = Document::new();
    for item in items {
        match item {
            Bson::Document(document) => merged.extend(document.clone()),
            value if is_null(value) => {}
            other => return Err(wrong_type(40_400, "$mergeObjects", "objects", other)),
        }
    }
    Ok(Some(Bson::Document(merged)))
}

fn name(arguments: &Arguments) -> Result<&str> {
    match arguments.get(0) {
        Bson::String(name) => Ok(name),
        other => Err(QueryError::invalid(
            3_041_704,
            format!("{} requires 'field' to evaluate to type String, not {}", arguments.operator, type_name(other)),
        )),
    }
}

fn get_field(arguments: &Arguments) -> Result<Value> {
    let name = name(arguments)?;
    match arguments.get(1) {
        Bson::Document(document) => Ok(document.get(name).cloned()),
        _ if !arguments.given(1) || is_missing(arguments, 1) => Ok(None),
        value if is_null(value) => Ok(Some(Bson::Null)),
        _ => Ok(None),
    }
}

fn is_missing(arguments: &Arguments, index: usize) -> bool {
    matches!(arguments.values.get(index), Some(Some(None)))
}

fn input(arguments: &Arguments) -> Result<Option<Document>> {
    match arguments.get(1) {
        Bson::Document(document) => Ok(Some(document.clone())),
        value if is_null(value) => Ok(None),
        other => Err(wrong_type(4_161_105, arguments.operator, "an object as input", other)),
    }
}

/// The name of a field to be written, which can hold no null character.
fn written_name(arguments: &Arguments) -> Result<&str> {
    let name = name(arguments)?;
    if name.contains('\0') {
        let message = format!("{}: 'field' cannot contain an embedded null byte", arguments.operator);
        return Err(QueryError::invalid(9_534_700, message));
    }
    Ok(name)
}

fn set_field(arguments: &Arguments) -> Result<Value> {
    let name = written_name(arguments)?;
    let Some(mut document) = input(arguments)? else { return Ok(Some(Bson::Null)) };
    if is_missing(arguments, 2) {
        document.remove(name);
    } else {
        document.insert(name, arguments.get(2).clone());
    }
    Ok(Some(Bson::Document(document)))
}

fn unset_field(arguments: &Arguments) -> Result<Value> {
    let name = written_name(arguments)?;
    let Some(mut document) = input(arguments)? else { return Ok(Some(Bson::Null)) };
    document.remove(name);
    Ok(Some(Bson::Document(document)))
}
