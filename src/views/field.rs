//! Values of fields, as what a chart can draw.

use bson::{Bson, Document};

/// The value under a dotted path; a number in it is an index of an array.
#[must_use]
pub fn lookup<'a>(document: &'a Document, path: &str) -> Option<&'a Bson> {
    let mut parts = path.split('.');
    let mut value = document.get(parts.next()?)?;
    for part in parts {
        value = match value {
            Bson::Document(inner) => inner.get(part)?,
            Bson::Array(values) => values.get(part.parse::<usize>().ok()?)?,
            _ => return None,
        };
    }
    Some(value)
}

/// The greatest number that is drawn: the length of an axis has to be a number, too.
const MAX: f64 = 1e300;

/// A value on an axis: a number, or a date as seconds since 1970.
#[must_use]
pub fn number(value: &Bson) -> Option<f64> {
    let number = match value {
        Bson::Double(number) => *number,
        Bson::Int32(number) => f64::from(*number),
        // What is drawn has fewer digits than a double.
        Bson::Int64(number) => *number as f64,
        Bson::Boolean(truth) => f64::from(u8::from(*truth)),
        Bson::DateTime(date) => date.timestamp_millis() as f64 / 1000.0,
        Bson::Decimal128(decimal) => decimal.to_string().parse().ok()?,
        _ => return None,
    };
    (number.abs() <= MAX).then_some(number)
}

/// Whether a value is a number that cannot be drawn: none, an infinite one, or one that is too large.
#[must_use]
pub fn is_undrawable(value: &Bson) -> bool {
    let is_number = matches!(value, Bson::Double(_) | Bson::Int32(_) | Bson::Int64(_) | Bson::Decimal128(_));
    is_number && number(value).is_none()
}

/// A value as people read it.
#[must_use]
pub fn text(value: &Bson) -> String {
    match value {
        Bson::String(text) => text.clone(),
        Bson::ObjectId(id) => id.to_hex(),
        Bson::DateTime(date) => date.try_to_rfc3339_string().unwrap_or_else(|_| date.to_string()),
        other => crate::formats::shell::relaxed_value(other),
    }
}
