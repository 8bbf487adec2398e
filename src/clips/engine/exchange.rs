//! Facts and values of CLIPS ⇄ those of documents.

use bson::{Bson, Document};

use super::native::{Environment, FactRef, Value};
use super::table::{Table, Thing};
use crate::clips::facts::{Exporter, Importer, Misfit, Nested, Schema};
use crate::formats::clips::{self, Body, Fact, Filled, Item, Reader, write_fact, write_operand};
use crate::formats::{Source, Span, shell};

/// The templates of these names, as CLIPS has them.
pub(super) fn schema<'n>(clips: &Environment, names: impl IntoIterator<Item = &'n str>) -> Schema {
    let mut schema = Schema::default();
    for name in names {
        if schema.get(name).is_some() {
            continue;
        }
        let Some(text) = clips.template(name) else { continue };
        for item in Reader::of_templates(&Source::new("<deftemplate>", text)) {
            if let Ok(Item::Template(template)) = item {
                schema.add(template);
            }
        }
    }
    schema
}

/// What is wrong with a fact of a text.
pub(super) fn check(fact: &Fact, schema: &Schema) -> Result<(), Misfit> {
    if matches!(fact.body, Body::Slots(_)) && schema.get(&fact.name).is_none() {
        return Err(Misfit { span: fact.span, message: format!("there is no deftemplate `{}`", fact.name) });
    }
    Importer { schema, strict: false }.document(fact).map(drop)
}

/// Asserts a fact.
pub(super) fn assert(fact: &Fact, clips: &Environment) -> Result<FactRef, String> {
    match &fact.body {
        Body::Ordered(_) => {
            let mut text = String::new();
            write_fact(fact, write_operand, &mut text);
            clips.assert_text(&text).ok_or_else(|| format!("CLIPS does not assert {text}"))
        }
        Body::Slots(slots) => {
            clips.assert(&fact.name, &filled(slots, &schema(clips, [fact.name.as_str()]), &fact.name))
        }
    }
}

/// The values of slots for CLIPS.
pub(super) fn filled(slots: &[Filled], schema: &Schema, template: &str) -> Vec<(String, Value)> {
    let template = schema.get(template);
    let multiple = |name: &str| template.and_then(|template| template.slot(name)).is_some_and(|slot| slot.multiple);
    let value = |slot: &Filled| match slot.values.as_slice() {
        [only] if !multiple(&slot.name) => native(only),
        values => Value::Many(values.iter().map(native).collect()),
    };
    slots.iter().map(|slot| (slot.name.clone(), value(slot))).collect()
}

fn native(value: &clips::Value) -> Value {
    match value {
        clips::Value::Symbol(text) => Value::Symbol(text.clone()),
        clips::Value::Text(text) => Value::Text(text.clone()),
        clips::Value::Integer(number) => Value::Integer(*number),
        clips::Value::Float(number) => Value::Float(*number),
        clips::Value::Instance(name) => Value::Instance(name.clone()),
    }
}

/// A value as a text of CLIPS can have it.
fn plain(value: Value) -> Result<clips::Value, String> {
    match value {
        Value::Symbol(text) => Ok(clips::Value::Symbol(text)),
        Value::Text(text) => Ok(clips::Value::Text(text)),
        Value::Integer(number) => Ok(clips::Value::Integer(number)),
        Value::Float(number) if number.is_finite() => Ok(clips::Value::Float(number)),
        Value::Float(_) => Err("holds a number that is infinite or none".to_owned()),
        Value::Instance(name) => Ok(clips::Value::Instance(name)),
        other => Err(format!("holds a {}, which no document can", other.kind())),
    }
}

/// A slot of CLIPS as a slot of a text.
pub(super) fn slot(name: &str, value: Value) -> Result<Filled, String> {
    let wrong = |what: String| format!("the slot `{name}` {what}");
    let (values, multiple) = match value {
        Value::Many(values) => (values.into_iter().map(plain).collect::<Result<_, _>>().map_err(wrong)?, true),
        value => (vec![plain(value).map_err(wrong)?], false),
    };
    Ok(Filled { name: name.to_owned(), values, multiple, computed: false, span: Span::default() })
}

/// A fact of CLIPS as one of a text.
pub(super) fn fact(fact: &FactRef, clips: &Environment) -> Result<Fact, String> {
    let name = clips.template_of(fact);
    let body = match clips.ordered(fact) {
        Some(values) => {
            let values: Result<_, _> = values.into_iter().map(plain).collect();
            Body::Ordered(values.map_err(|what| format!("the fact {what}"))?)
        }
        None => {
            let slots = clips.slots(fact).into_iter().map(|(name, value)| slot(&name, value));
            Body::Slots(slots.collect::<Result<_, _>>()?)
        }
    };
    Ok(Fact { name, body, span: Span::default() })
}

/// The document that a fact of CLIPS is. Documents that it has addresses of become part of it.
pub(super) fn document(of: &FactRef, clips: &Environment, table: &mut Table) -> Result<Document, String> {
    let name = clips.template_of(of);
    if clips.ordered(of).is_some() {
        let fact = fact(of, clips)?;
        return imported(&fact, &Schema::default());
    }
    let (mut slots, mut nested) = (Vec::new(), Vec::new());
    for (name, value) in clips.slots(of) {
        match value {
            Value::Address(address) => nested.push((name, table.value(address)?)),
            value => slots.push(slot(&name, value)?),
        }
    }
    let mut schema = Schema::default();
    if nested.is_empty() {
        schema = self::schema(clips, [name.as_str()]);
    }
    let mut document = imported(&Fact { name, body: Body::Slots(slots), span: Span::default() }, &schema)?;
    document.extend(nested);
    Ok(document)
}

/// The document that a fact of a text is.
pub(super) fn imported(fact: &Fact, schema: &Schema) -> Result<Document, String> {
    Importer { schema, strict: false }.document(fact).map_err(|misfit| misfit.message)
}

/// The fact that a document is.
pub(super) fn exported(document: &Document, schema: &Schema) -> Result<Fact, String> {
    let exporter = Exporter { schema, nested: Nested::Refuse, strict: false };
    exporter.fact(document).map_err(|error| error.to_string())
}

/// A value of CLIPS in a document. TRUE and FALSE are booleans there, as in facts.
pub(super) fn to_bson(value: &Value, table: &mut Table) -> Result<Bson, String> {
    Ok(match value {
        Value::Symbol(text) if text == "TRUE" => Bson::Boolean(true),
        Value::Symbol(text) if text == "FALSE" => Bson::Boolean(false),
        Value::Symbol(text) | Value::Text(text) => Bson::String(text.clone()),
        Value::Instance(name) => Bson::String(format!("[{name}]")),
        Value::Integer(number) => Bson::Int64(*number),
        Value::Float(number) => Bson::Double(*number),
        Value::Address(address) => table.value(*address)?,
        Value::Many(values) => Bson::Array(values.iter().map(|value| to_bson(value, table)).collect::<Result<_, _>>()?),
        other => return Err(format!("a {} cannot be in a document", other.kind())),
    })
}

/// A value of a document in CLIPS. Dates are seconds and microseconds; what CLIPS has no word for is JSON.
pub(super) fn to_value(value: &Bson, table: &mut Table) -> Value {
    match value {
        Bson::String(text) | Bson::Symbol(text) => Value::Text(text.clone()),
        Bson::Boolean(flag) => Value::truth(*flag),
        Bson::Int32(number) => Value::Integer(i64::from(*number)),
        Bson::Int64(number) => Value::Integer(*number),
        Bson::Double(number) => Value::Float(*number),
        Bson::Null => Value::Symbol("nil".to_owned()),
        Bson::ObjectId(id) => Value::Text(id.to_hex()),
        Bson::DateTime(date) => time(date.timestamp_millis()),
        Bson::Document(document) => Value::Address(table.add(Thing::Document(document.clone()))),
        Bson::Array(values) => Value::Many(values.iter().map(|value| element(value, table)).collect()),
        other => Value::Text(shell::relaxed_value(other)),
    }
}

/// A value in a multifield, which holds no multifields.
fn element(value: &Bson, table: &mut Table) -> Value {
    match value {
        Bson::Array(values) => Value::Address(table.add(Thing::Array(values.clone()))),
        Bson::DateTime(_) => Value::Text(shell::relaxed_value(value)),
        other => to_value(other, table),
    }
}

/// Seconds and microseconds since 1970.
pub(super) fn time(milliseconds: i64) -> Value {
    let (seconds, rest) = (milliseconds.div_euclid(1_000), milliseconds.rem_euclid(1_000));
    Value::Many(vec![Value::Integer(seconds), Value::Integer(rest * 1_000)])
}
