//! Values by the keys of markers, and their texts.

use bson::RawDocument;
use bson::raw::RawBsonRef;

use crate::formats::is_alike;

/// The value of a flattened key: `position_translation_0` is `position.translation[0]`.
/// A key that is there as it is goes before one that is put together. The key's length bounds the depth.
pub(super) fn resolve<'a>(document: &'a RawDocument, key: &str) -> Option<RawBsonRef<'a>> {
    if let Some(value) = document.get(key).ok().flatten() {
        return Some(value).filter(|value| !matches!(value, RawBsonRef::Document(_)));
    }
    for (name, value) in document.iter().filter_map(Result::ok) {
        let Some(rest) = key.strip_prefix(name.as_str()).and_then(|rest| rest.strip_prefix('_')) else { continue };
        if let Some(found) = inside(value, rest) {
            return Some(found);
        }
    }
    None
}

fn inside<'a>(value: RawBsonRef<'a>, key: &str) -> Option<RawBsonRef<'a>> {
    match value {
        RawBsonRef::Document(document) => resolve(document, key),
        RawBsonRef::Array(array) => {
            let (index, rest) = key.split_once('_').map_or((key, None), |(index, rest)| (index, Some(rest)));
            let canonical = index == "0" || !index.starts_with(['0', '+']);
            let element = array.get(index.parse().ok().filter(|_| canonical)?).ok().flatten()?;
            match rest {
                Some(rest) => inside(element, rest),
                None => Some(element).filter(|element| !matches!(element, RawBsonRef::Document(_))),
            }
        }
        _ => None,
    }
}

/// The value of a key that differs from this one only in hyphens and underscores, with that key.
pub(super) fn resolve_alike<'a>(document: &'a RawDocument, key: &str) -> Option<(String, RawBsonRef<'a>)> {
    for (name, value) in document.iter().filter_map(Result::ok) {
        let name = name.as_str();
        if is_alike(name, key) && !matches!(value, RawBsonRef::Document(_)) {
            return Some((name.to_owned(), value));
        }
        let Some((first, rest)) = key.split_at_checked(name.len()) else { continue };
        let Some(rest) = rest.strip_prefix('_').filter(|_| is_alike(name, first)) else { continue };
        let found = match value {
            RawBsonRef::Document(inner) => resolve_alike(inner, rest),
            value => inside(value, rest).map(|found| (rest.to_owned(), found)),
        };
        if let Some((rest, value)) = found {
            return Some((format!("{name}_{rest}"), value));
        }
    }
    None
}

/// A scalar as the marker spelling writes it, and whether it is a number.
pub(super) fn spell(value: RawBsonRef<'_>) -> Option<(String, bool)> {
    Some(match value {
        RawBsonRef::String(text) | RawBsonRef::Symbol(text) => (text.to_owned(), false),
        RawBsonRef::Int32(number) => (number.to_string(), true),
        RawBsonRef::Int64(number) => (number.to_string(), true),
        RawBsonRef::Double(number) if number.is_finite() => (format!("{number:.6}"), true),
        RawBsonRef::Boolean(flag) => (u8::from(flag).to_string(), true),
        RawBsonRef::ObjectId(id) => (id.to_hex(), false),
        _ => return None,
    })
}

/// What a value is that has no text.
pub(super) fn kind(value: RawBsonRef<'_>) -> &'static str {
    match value {
        RawBsonRef::Null => "null",
        RawBsonRef::DateTime(_) => "a date",
        RawBsonRef::RegularExpression(_) => "a regular expression",
        RawBsonRef::Array(_) => "an array in an array",
        RawBsonRef::Document(_) => "a document",
        RawBsonRef::Double(_) => "not a finite number",
        _ => "of a type",
    }
}
