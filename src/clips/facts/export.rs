//! Documents to facts.

use std::borrow::Cow;
use std::collections::BTreeSet;

use bson::{Bson, Document};

use super::error::{FactError, Remedy};
use super::key::{RELATION, VALUES};
use super::nested::{self, Nested};
use super::record::{Record, labels};
use super::schema::{INITIAL, Schema};
use crate::formats::Span;
use crate::formats::clips::{
    Body, Default, Fact, Filled, Slot, Template, Types, Value, is_construct, is_instance, is_symbol,
};
use crate::store::metadata;

/// Whether CLIPS takes a word for something else at the head of a fact.
pub(super) fn is_reserved(name: &str) -> bool {
    is_construct(name) || RESERVED.contains(&name)
}

/// The conditional elements of rules.
const RESERVED: [&str; 9] = ["and", "or", "not", "test", "logical", "exists", "forall", "object", "declare"];

/// How documents become facts.
#[derive(Debug, Clone, Copy)]
pub struct Exporter<'a> {
    /// The known templates.
    pub schema: &'a Schema,
    /// What becomes of values that no slot can hold.
    pub nested: Nested,
    /// Whether every template has to be known.
    pub strict: bool,
}

impl Exporter<'_> {
    /// The fact that a document is.
    ///
    /// # Errors
    /// Naming the key that cannot be represented, or does not fit its template.
    pub fn fact(&self, document: &Document) -> Result<Fact, FactError> {
        let record = Record::of(document);
        let name = relation(document)?;
        let template = self.schema.get(name);
        if template.is_none() && self.strict && name != INITIAL {
            return Err(FactError::new(RELATION, format!("names the template `{name}`, which is not known")));
        }
        let document = match self.nested {
            Nested::Flatten => Cow::Owned(nested::flatten(document)?),
            _ => Cow::Borrowed(document),
        };
        let body = match (ordered(&document), template) {
            (Some(values), None) if !record.slots => Body::Ordered(self.values(VALUES, values, &record, None)?),
            _ => Body::Slots(self.slots(&document, &record, template)?),
        };
        Ok(Fact { name: name.to_owned(), body, span: Span::default() })
    }

    fn slots(
        &self,
        document: &Document,
        record: &Record,
        template: Option<&Template>,
    ) -> Result<Vec<Filled>, FactError> {
        let mut slots = Vec::new();
        for (key, value) in document.iter().filter(|(key, _)| is_slot(key)) {
            let name = record.names.get(key).unwrap_or(key);
            if !is_symbol(name) {
                return Err(FactError::new(key, "is not a symbol, and cannot be the name of a slot"));
            }
            let is_given = |slot: &str| document.contains_key(slot);
            let slot = template
                .map(|template| known(self.schema.slot(template, name, is_given), template, name))
                .transpose()?;
            let values = match value {
                Bson::Array(values) => self.values(name, values, record, slot)?,
                value => vec![self.value(name, None, value, record, slot)?],
            };
            if let Some(slot) = slot {
                slot.check(&values).map_err(|message| FactError::new(key, format!("does not fit: {message}")))?;
            }
            let multiple = slot.is_none() && matches!(value, Bson::Array(_));
            let name = slot.map_or(name, |slot| &slot.name);
            slots.push(Filled { name: name.clone(), values, multiple, computed: false, span: Span::default() });
        }
        let missing =
            |slot: &&Slot| slot.default == Default::None && slots.iter().all(|filled| filled.name != slot.name);
        match template.and_then(|template| template.slots.iter().find(missing)) {
            Some(slot) => Err(FactError::new(&slot.name, "is missing; its slot has no default")),
            None => Ok(slots),
        }
    }

    fn values(
        &self,
        name: &str,
        values: &[Bson],
        record: &Record,
        slot: Option<&Slot>,
    ) -> Result<Vec<Value>, FactError> {
        let value = |(place, value)| self.value(name, Some(place), value, record, slot);
        values.iter().enumerate().map(value).collect()
    }

    fn value(
        &self,
        name: &str,
        place: Option<usize>,
        value: &Bson,
        record: &Record,
        slot: Option<&Slot>,
    ) -> Result<Value, FactError> {
        let types = slot.map_or(Types::ANY, |slot| slot.types);
        let wrong = |message: String| FactError::new(name, message);
        match value {
            Bson::String(text) => lexeme(text, &labels(name, place, text), record, types).map_err(wrong),
            Bson::Symbol(text) if is_symbol(text) => Ok(Value::Symbol(text.clone())),
            Bson::Boolean(flag) => Ok(Value::Symbol(if *flag { "TRUE" } else { "FALSE" }.to_owned())),
            Bson::Int32(number) => Ok(integer(i64::from(*number), types)),
            Bson::Int64(number) => Ok(integer(*number, types)),
            Bson::Double(number) if number.is_finite() => Ok(Value::Float(*number)),
            other if self.nested == Nested::Json => Ok(Value::Text(nested::json(other))),
            other => {
                let remedy = match other {
                    Bson::Document(_) | Bson::Array(_) if self.nested == Nested::Refuse => Remedy::Flatten,
                    _ => Remedy::Json,
                };
                Err(wrong(format!("is {}, which no slot can hold", kind(other))).remedy(remedy))
            }
        }
    }
}

/// Checks that `(load-facts)` reads a fact as it is written: CLIPS takes the symbol `=` for the start of a function call.
///
/// # Errors
/// Naming the slot with that symbol.
pub fn loadable(fact: &Fact) -> Result<(), FactError> {
    let has_equals = |values: &[Value]| values.iter().any(|value| matches!(value, Value::Symbol(text) if text == "="));
    let slot = match &fact.body {
        Body::Ordered(values) => has_equals(values).then_some(VALUES),
        Body::Slots(slots) => slots.iter().find(|slot| has_equals(&slot.values)).map(|slot| slot.name.as_str()),
    };
    match slot {
        Some(key) => {
            Err(FactError::new(key, "has the symbol `=`, which (load-facts) cannot read").remedy(Remedy::Form))
        }
        None => Ok(()),
    }
}

/// The name of the template.
fn relation(document: &Document) -> Result<&str, FactError> {
    let wrong = |message: String| Err(FactError::new(RELATION, message));
    match document.get(RELATION) {
        None => Err(FactError::new(RELATION, "is missing; expected the name of a template").remedy(Remedy::Query)),
        Some(Bson::String(name)) if is_reserved(name) => wrong(format!("is `{name}`, which CLIPS keeps for itself")),
        Some(Bson::String(name)) if is_symbol(name) => Ok(name),
        Some(Bson::String(name)) => {
            wrong(format!("is \"{}\", which is not a symbol and cannot be the name of a template", name.escape_debug()))
        }
        Some(other) => {
            let message = format!("is {}; expected the name of a template", kind(other));
            Err(FactError::new(RELATION, message).remedy(Remedy::Query))
        }
    }
}

fn is_slot(key: &str) -> bool {
    !matches!(key, RELATION | "_id" | metadata::INFO)
}

/// The values of an ordered fact.
fn ordered(document: &Document) -> Option<&[Bson]> {
    let mut keys = document.iter().filter(|(key, _)| is_slot(key));
    match (keys.next(), keys.next()) {
        (None, _) => Some(&[]),
        (Some((key, Bson::Array(values))), None) if key == VALUES => Some(values),
        _ => None,
    }
}

fn known<'t>(slot: Option<&'t Slot>, template: &Template, name: &str) -> Result<&'t Slot, FactError> {
    slot.ok_or_else(|| {
        let names: Vec<&str> = template.slots.iter().map(|slot| slot.name.as_str()).collect();
        let message = format!("is not a slot of `{}`; expected {}", template.name, names.join(", "));
        FactError::new(name, message)
    })
}

/// The value that a string is, by what is recorded, by its slot's types, or by how it looks.
fn lexeme(text: &str, labels: &[String], record: &Record, types: Types) -> Result<Value, String> {
    if text.contains('\0') {
        return Err("holds a NUL character, which no string of CLIPS can".to_owned());
    }
    let instance = text.strip_prefix('[').and_then(|text| text.strip_suffix(']')).filter(|name| is_instance(name));
    let quoted = || Ok(Value::Text(text.to_owned()));
    let is_in = |noted: &BTreeSet<String>| labels.iter().any(|label| noted.contains(label));
    match instance {
        Some(name) if types.has(Types::INSTANCE) && (is_in(&record.instances) || !types.has(Types::STRING)) => {
            Ok(Value::Instance(name.to_owned()))
        }
        _ if is_in(&record.strings) && types.has(Types::STRING) => quoted(),
        _ if types.has(Types::SYMBOL) && looks_like_a_symbol(text) => Ok(Value::Symbol(text.to_owned())),
        // Programs for Fawkes store the symbols TRUE and FALSE as texts.
        _ if types.has(Types::SYMBOL) && !types.has(Types::STRING) && is_symbol(text) => {
            Ok(Value::Symbol(text.to_owned()))
        }
        _ if types.has(Types::SYMBOL) && !types.has(Types::STRING) => {
            Err(format!("is \"{}\"; expected {}", text.escape_debug(), types.names()))
        }
        _ => quoted(),
    }
}

/// Whether a string is written without quotes. `TRUE` and `FALSE` are booleans in documents.
pub(super) fn looks_like_a_symbol(text: &str) -> bool {
    !matches!(text, "TRUE" | "FALSE") && is_symbol(text)
}

/// An integer, or where only floats go and none is lost, a float.
#[allow(clippy::cast_precision_loss, reason = "only exact numbers are converted")]
fn integer(number: i64, types: Types) -> Value {
    let exact = number.unsigned_abs() <= 1 << f64::MANTISSA_DIGITS;
    match types.has(Types::FLOAT) && !types.has(Types::INTEGER) && exact {
        true => Value::Float(number as f64),
        false => Value::Integer(number),
    }
}

fn kind(value: &Bson) -> &'static str {
    match value {
        Bson::Document(_) => "a nested document",
        Bson::Array(_) => "an array in an array",
        Bson::Double(number) if number.is_nan() => "NaN",
        Bson::Double(_) => "an infinite number",
        Bson::Int32(_) | Bson::Int64(_) => "a number",
        Bson::Decimal128(_) => "a decimal number",
        Bson::Null => "null",
        Bson::Boolean(_) => "a boolean",
        Bson::DateTime(_) => "a date",
        Bson::ObjectId(_) => "an ObjectId",
        Bson::Binary(_) => "binary data",
        Bson::RegularExpression(_) => "a regular expression",
        Bson::Timestamp(_) => "a timestamp",
        _ => "of a type",
    }
}
