//! Facts to documents.

use std::borrow::Cow;
use std::mem::discriminant;

use bson::{Bson, Document, doc};

use super::export::{is_reserved, looks_like_a_symbol};
use super::record::{self, Record, by_place, by_text};
use super::schema::{INITIAL, Schema};
use super::{RELATION, VALUES};
use crate::formats::Span;
use crate::formats::clips::{Body, Default, Fact, Filled, Template, Types, Value};
use crate::store::metadata;

/// A fact that does not fit its template.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Misfit {
    /// Where in the text of the fact.
    pub span: Span,
    /// What was expected, as a fragment.
    pub message: String,
}

/// How facts become documents.
#[derive(Debug, Clone, Copy)]
pub struct Importer<'a> {
    /// The known templates.
    pub schema: &'a Schema,
    /// Whether every template has to be known.
    pub strict: bool,
}

impl Importer<'_> {
    /// The document that a fact is, without `_id`.
    ///
    /// # Errors
    /// Where the fact does not fit its template, or has to have one.
    pub fn document(&self, fact: &Fact) -> Result<Document, Misfit> {
        let template = self.schema.get(&fact.name);
        let wrong = |message: String| Misfit { span: fact.span, message };
        let mut document = doc! { RELATION: &fact.name };
        let mut record = Record::default();
        if is_reserved(&fact.name) {
            let message = format!("no fact can begin with `{}`, which CLIPS keeps for itself", fact.name);
            return Err(wrong(message));
        }
        match (&fact.body, template) {
            (_, None) if self.strict && fact.name != INITIAL => {
                return Err(wrong(format!("the template `{}` is not known", fact.name)));
            }
            (Body::Ordered(_), Some(template)) if !template.slots.is_empty() => {
                return Err(wrong(format!("expected the slots of `{}`, found an ordered fact", template.name)));
            }
            (Body::Ordered(values), _) => {
                document.insert(VALUES, array(VALUES, values, &mut record));
            }
            (Body::Slots(slots), _) => {
                let slots = &*self.spelled(slots, template);
                slots_of(slots, template, &mut document, &mut record)?;
                if let Some(template) = template {
                    fill(template, slots, &mut document, &mut record).map_err(wrong)?;
                }
                record.slots = document.len() == 2 && matches!(document.get(VALUES), Some(Bson::Array(_)));
            }
        }
        if let Some(clips) = record.into_document() {
            document.insert(metadata::INFO, doc! { record::KEY: clips });
        }
        Ok(document)
    }
}

impl Importer<'_> {
    /// The slots with the names that their template has for them.
    fn spelled<'s>(&self, slots: &'s [Filled], template: Option<&Template>) -> Cow<'s, [Filled]> {
        let Some(template) = template else { return Cow::Borrowed(slots) };
        let mut spelled = Cow::Borrowed(slots);
        for (nth, filled) in slots.iter().enumerate().filter(|(_, filled)| template.slot(&filled.name).is_none()) {
            let is_given = |name: &str| slots.iter().any(|other| other.name == name);
            let Some(slot) = self.schema.slot(template, &filled.name, is_given) else { continue };
            if let Some(filled) = spelled.to_mut().get_mut(nth) {
                filled.name.clone_from(&slot.name);
            }
        }
        spelled
    }
}

fn slots_of(
    slots: &[Filled],
    template: Option<&Template>,
    document: &mut Document,
    record: &mut Record,
) -> Result<(), Misfit> {
    for filled in slots {
        let wrong = |message: String| Misfit { span: filled.span, message };
        let slot = match template {
            None => None,
            Some(template) => Some(template.slot(&filled.name).ok_or_else(|| {
                let names: Vec<&str> = template.slots.iter().map(|slot| slot.name.as_str()).collect();
                wrong(format!("`{}` is not a slot of `{}`; expected {}", filled.name, template.name, names.join(", ")))
            })?),
        };
        let values = match slot {
            Some(slot) if filled.computed => floats(&filled.values, slot.types),
            _ => Cow::Borrowed(filled.values.as_slice()),
        };
        if let Some(slot) = slot {
            slot.check(&values).map_err(wrong)?;
        }
        let multiple = slot.map_or(filled.multiple || filled.values.len() != 1, |slot| slot.multiple);
        let key = key(&filled.name, slots, record);
        document.insert(key, value(&filled.name, &values, multiple, record));
    }
    Ok(())
}

/// Integers as floats where a slot takes floats only: of computed values CLIPS does not check the type.
fn floats(values: &[Value], types: Types) -> Cow<'_, [Value]> {
    if types.has(Types::INTEGER) || !types.has(Types::FLOAT) {
        return Cow::Borrowed(values);
    }
    let float = |value: &Value| match value {
        #[allow(clippy::cast_precision_loss, reason = "as CLIPS does it")]
        Value::Integer(number) => Value::Float(*number as f64),
        other => other.clone(),
    };
    Cow::Owned(values.iter().map(float).collect())
}

/// Adds what the fact does not say.
fn fill(template: &Template, slots: &[Filled], document: &mut Document, record: &mut Record) -> Result<(), String> {
    for slot in template.slots.iter().filter(|slot| slots.iter().all(|filled| filled.name != slot.name)) {
        if slot.default == Default::None {
            return Err(format!("the slot `{}` of `{}` has to be given", slot.name, template.name));
        }
        if let Some(values) = slot.fill() {
            let key = key(&slot.name, slots, record);
            document.insert(key, value(&slot.name, &values, slot.multiple, record));
        }
    }
    Ok(())
}

/// The key of a slot: its name, if that is free for applications to use.
fn key(name: &str, slots: &[Filled], record: &mut Record) -> String {
    if !matches!(name, RELATION | "_id" | metadata::INFO) && !name.starts_with('$') {
        return name.to_owned();
    }
    let mut key = if name.starts_with('$') { format!("_{name}") } else { format!("{name}_") };
    while slots.iter().any(|slot| slot.name == key) {
        key.push('_');
    }
    record.names.insert(key.clone(), name.to_owned());
    key
}

fn value(slot: &str, values: &[Value], multiple: bool, record: &mut Record) -> Bson {
    match values {
        [only] if !multiple => single(&|_| slot.to_owned(), only, record),
        values => Bson::Array(array(slot, values, record)),
    }
}

fn array(slot: &str, values: &[Value], record: &mut Record) -> Vec<Bson> {
    let single = |(place, value)| {
        let is_another = |other: &Value, text: &str| {
            discriminant(other) != discriminant(value) && in_document(other).is_some_and(|other| other == text)
        };
        let is_ambiguous = |text: &str| values.iter().any(|other| is_another(other, text));
        let label = |text: &str| if is_ambiguous(text) { by_place(slot, place) } else { by_text(slot, text) };
        single(&label, value, record)
    };
    values.iter().enumerate().map(single).collect()
}

/// The text that a value is in a document, where it is one.
fn in_document(value: &Value) -> Option<Cow<'_, str>> {
    match value {
        Value::Symbol(text) | Value::Text(text) => Some(text.into()),
        Value::Instance(name) => Some(format!("[{name}]").into()),
        Value::Integer(_) | Value::Float(_) => None,
    }
}

/// The value, of which is noted by its label what a document would lose.
fn single(label: &dyn Fn(&str) -> String, value: &Value, record: &mut Record) -> Bson {
    match value {
        Value::Symbol(text) if text == "TRUE" => Bson::Boolean(true),
        Value::Symbol(text) if text == "FALSE" => Bson::Boolean(false),
        Value::Symbol(text) => Bson::String(text.clone()),
        Value::Text(text) => {
            if looks_like_a_symbol(text) {
                record.strings.insert(label(text));
            }
            Bson::String(text.clone())
        }
        Value::Integer(number) => i32::try_from(*number).map_or(Bson::Int64(*number), Bson::Int32),
        Value::Float(number) => Bson::Double(*number),
        Value::Instance(name) => {
            let text = format!("[{name}]");
            record.instances.insert(label(&text));
            Bson::String(text)
        }
    }
}
