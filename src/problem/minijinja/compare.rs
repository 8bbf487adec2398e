//! Comparisons of values whose types differ: minijinja takes them for unequal, and orders them by their types.

use std::sync::Arc;

use bson::Bson;
use minijinja::value::{Value, ValueKind};
use minijinja::{Environment, Error};

use super::advice::Hint;
use super::compared::{Mixed, Remedy, Side, whole};
use super::comparisons::{AFTER, BEFORE, LEFT, RIGHT};
use super::context::{Context, invalid};
use super::direct::lock;
use super::value::Other;
use crate::formats::shell;

/// How many elements of a list are looked at.
const ELEMENTS: usize = 1_000;
/// The longest value that a message shows, in characters.
const SHOWN: usize = 40;

/// Gives an environment the filters that look at comparisons, and tests that refuse to order what has no order.
pub(super) fn register(environment: &mut Environment<'_>, context: &Arc<Context>) {
    let shared = Arc::clone(context);
    environment.add_filter(BEFORE, move |value: Value, site: usize, operator: &str, literal: &Value| {
        compare(&shared, site, &value, operator, literal).map(|()| value)
    });
    let shared = Arc::clone(context);
    environment.add_filter(AFTER, move |value: Value, site: usize, operator: &str, literal: &Value| {
        compare(&shared, site, literal, operator, &value).map(|()| value)
    });
    let shared = Arc::clone(context);
    environment.add_filter(LEFT, move |value: Value, site: usize| {
        lock(&shared.compared.open).push((site, value.clone()));
        value
    });
    let shared = Arc::clone(context);
    environment.add_filter(RIGHT, move |value: Value, site: usize, operator: &str| {
        let left = lock(&shared.compared.open).pop().filter(|(known, _)| *known == site);
        left.map_or(Ok(()), |(_, left)| compare(&shared, site, &left, operator, &value)).map(|()| value)
    });
    type Test = fn(&Value, &Value) -> bool;
    let tests: [(&[&'static str], Test); 4] = [
        (&["lt", "lessthan", "<"], |left, right| left < right),
        (&["le", "<="], |left, right| left <= right),
        (&["gt", "greaterthan", ">"], |left, right| left > right),
        (&["ge", ">="], |left, right| left >= right),
    ];
    for (name, test) in tests.into_iter().flat_map(|(names, test)| names.iter().map(move |name| (*name, test))) {
        let shared = Arc::clone(context);
        environment.add_test(name, move |left: &Value, right: &Value| {
            ordered(&shared, None, left, right).map(|()| test(left, right))
        });
    }
}

fn compare(context: &Context, site: usize, left: &Value, operator: &str, right: &Value) -> Result<(), Error> {
    let compared = &context.compared;
    if operator.starts_with(['<', '>']) {
        let sides = compared.sides.get(&site);
        return ordered(context, sides, left, right).inspect_err(|_| *lock(&compared.refused) = sides.map(whole));
    }
    // One remark is made of a comparison, however many pairs it compares.
    if lock(&compared.mixed).contains_key(&site) {
        return Ok(());
    }
    let mixed = if operator == "in" { member(context, left, right) } else { equal(context, left, right) };
    if let Some(mixed) = mixed {
        lock(&compared.mixed).insert(site, mixed);
    }
    Ok(())
}

/// Refuses to order values of different types.
fn ordered(context: &Context, sides: Option<&(Side, Side)>, left: &Value, right: &Value) -> Result<(), Error> {
    let (kind, other) = (left.kind(), right.kind());
    let is_number = |kind| matches!(kind, ValueKind::Number | ValueKind::Bool);
    let is_unknown = |kind| matches!(kind, ValueKind::Undefined | ValueKind::Invalid);
    if kind == other || (is_number(kind) && is_number(other)) || is_unknown(kind) || is_unknown(other) {
        return Ok(());
    }
    let message = format!("{} and {} have no order", described(context, left), described(context, right));
    let is_convertible =
        |value: &Value| matches!(value.downcast_object_ref(), Some(Other(Bson::DateTime(_) | Bson::Decimal128(_))));
    let hint = if kind == ValueKind::None || other == ValueKind::None {
        let side = sides.map(|(left, right)| if kind == ValueKind::None { left } else { right });
        let written = side.map_or("value", |side| side.text.as_str());
        Some(format!("test for null first: {{% if {written} is not none and … %}}"))
    } else if is_convertible(left) || is_convertible(right) {
        Some(context.compared.hint(Remedy { is_left: is_convertible(left), filter: "number" }, sides))
    } else {
        let text = if kind == ValueKind::String { left } else { right };
        let number = reading(context, text).filter(|_| is_number(kind) || is_number(other));
        let remedy = |number: f64| Remedy { is_left: kind == ValueKind::String, filter: converter(number) };
        number.map(|number| context.compared.hint(remedy(number), sides))
    };
    let error = invalid(message);
    Err(match hint {
        Some(hint) => error.with_source(Hint(hint)),
        None => error,
    })
}

/// A pair that is unequal only by its types.
fn equal(context: &Context, left: &Value, right: &Value) -> Option<Mixed> {
    if left.kind() == right.kind() {
        return None;
    }
    let (is_left, filter) = differing(context, left, right)
        .map(|filter| (true, filter))
        .or_else(|| differing(context, right, left).map(|filter| (false, filter)))?;
    let message = format!("{} and {} are never equal", described(context, left), described(context, right));
    Some(Mixed { message, remedy: Remedy { is_left, filter } })
}

/// The filter that makes the one value equal to the other, where only its type differs.
fn differing(context: &Context, value: &Value, other: &Value) -> Option<&'static str> {
    match value.downcast_object_ref() {
        Some(Other(Bson::Decimal128(decimal))) if other.is_number() => {
            (decimal.to_string().parse().ok() == number(other)).then_some("number")
        }
        Some(Other(Bson::ObjectId(id))) => (id.to_hex() == other.as_str()?).then_some("string"),
        Some(_) => None,
        None if other.is_number() => {
            let reading = reading(context, value)?;
            (Some(reading) == number(other)).then(|| converter(reading))
        }
        None => None,
    }
}

/// A value that is in no list, since the element that reads as it has another type. A list whose first element has the
/// type of the value is not gone through.
fn member(context: &Context, value: &Value, list: &Value) -> Option<Mixed> {
    if list.kind() != ValueKind::Seq {
        return None;
    }
    let elements = || list.try_iter().ok().into_iter().flat_map(|elements| elements.take(ELEMENTS));
    if elements().next().is_none_or(|first| first.kind() == value.kind()) || elements().any(|one| one == *value) {
        return None;
    }
    let is_alike = |element: &Value| equal(context, value, element).is_some();
    let element = elements().find(is_alike)?;
    let message =
        format!("{} and {} of the list are never equal", described(context, value), described(context, &element));
    let filter = if value.is_number() { "string" } else { equal(context, value, &element)?.remedy.filter };
    Some(Mixed { message, remedy: Remedy { is_left: true, filter } })
}

/// The number that a text reads as.
fn reading(context: &Context, value: &Value) -> Option<f64> {
    context.plain(value.as_str()?).trim().parse::<f64>().ok().filter(|number| number.is_finite())
}

fn number(value: &Value) -> Option<f64> {
    f64::try_from(value.clone()).ok()
}

/// The filter that reads a text as this number.
fn converter(number: f64) -> &'static str {
    if number.fract() == 0.0 { "int" } else { "float" }
}

/// A value with its type.
fn described(context: &Context, value: &Value) -> String {
    let shown = match value.as_str() {
        Some(text) => shell::relaxed_value(&Bson::String(context.plain(text).into_owned())),
        None if value.is_none() => return "null".to_owned(),
        None => value.to_string(),
    };
    let kind = match (value.downcast_object_ref(), value.kind()) {
        (Some(Other(Bson::DateTime(_))), _) => "a date",
        (Some(Other(Bson::ObjectId(_))), _) => "an ObjectId",
        (Some(Other(Bson::Decimal128(_))), _) => "a decimal",
        (_, ValueKind::Number) => "a number",
        (_, ValueKind::String) => "a text",
        (_, ValueKind::Bool) => "a truth value",
        (_, ValueKind::Map) => return "a document".to_owned(),
        (_, ValueKind::Seq | ValueKind::Iterable) => return "a list".to_owned(),
        _ => "a value of another type",
    };
    match shown.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}… ({kind})", &shown[..end]),
        None => format!("{shown} ({kind})"),
    }
}
