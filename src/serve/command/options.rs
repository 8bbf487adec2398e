//! The options of commands by the types that MongoDB takes them in.

use bson::{Bson, Document};

use crate::query::type_name;
use crate::serve::failure::{Failure, codes};
use crate::serve::fields::is_generic;

/// What an option may be.
#[derive(Debug, Clone, Copy)]
pub(super) enum Type {
    /// True or false.
    Bool,
    /// True or false, or a number that stands for it.
    Flag,
    Number,
    Text,
    /// A text, or a number.
    TextOrNumber,
    /// One of these texts.
    OneOf(&'static [&'static str]),
    Object,
    /// A document, or what [`Type::Flag`] is.
    ObjectOrFlag,
    /// A document with these options, of which one may have to be there.
    Of(Option<&'static str>, &'static [(&'static str, Type)]),
    /// A document that has to have this key.
    With(&'static str),
    Array,
}

/// Options by name.
pub(super) type Options = &'static [(&'static str, Type)];

/// Checks the options of a command; null is as if left out.
///
/// # Errors
/// If MongoDB does not know one, or takes it in another type.
pub(super) fn check(command: &str, body: &Document, options: Options) -> Result<(), Failure> {
    body.iter().skip(1).filter(|(name, _)| !is_generic(name)).try_for_each(|given| check_one(command, given, options))
}

/// Checks the options in a document of a command.
///
/// # Errors
/// As [`check`].
pub(super) fn check_inside(of: &str, document: &Document, options: Options) -> Result<(), Failure> {
    document.iter().try_for_each(|given| check_one(of, given, options))
}

fn check_one(of: &str, (name, value): (&String, &Bson), options: Options) -> Result<(), Failure> {
    let Some((_, wanted)) = options.iter().find(|(known, _)| known == name) else {
        return Err(Failure::malformed(codes::UNKNOWN_FIELD, format!("BSON field '{of}.{name}' is an unknown field.")));
    };
    // Null is a type of its own where there are several.
    if matches!(value, Bson::Null | Bson::Undefined) && !matches!(wanted, Type::TextOrNumber) {
        return Ok(());
    }
    let place = format!("{of}.{name}");
    if !wanted.takes(value) {
        let (found, expected) = (type_name(value), wanted.names());
        let message = format!("BSON field '{place}' is the wrong type '{found}', expected type '{expected}'");
        return Err(Failure::malformed(codes::TYPE_MISMATCH, message));
    }
    match (wanted, value) {
        (Type::OneOf(values), Bson::String(text)) if !values.contains(&text.as_str()) => {
            let message = format!("Enumeration value '{text}' for field '{place}' is not a valid value.");
            Err(Failure::new(codes::BAD_VALUE, message))
        }
        (Type::Of(needed, inner), Bson::Document(document)) => {
            check_inside(&place, document, inner)?;
            needed.map_or(Ok(()), |needed| check_needed(&place, document, needed))
        }
        (Type::With(needed), Bson::Document(document)) => check_needed(&place, document, needed),
        _ => Ok(()),
    }
}

fn check_needed(place: &str, document: &Document, name: &str) -> Result<(), Failure> {
    match document.get(name) {
        None | Some(Bson::Null | Bson::Undefined) => {
            let message = format!("BSON field '{place}.{name}' is missing but a required field");
            Err(Failure::malformed(codes::MISSING_FIELD, message))
        }
        Some(_) => Ok(()),
    }
}

impl Type {
    fn takes(self, value: &Bson) -> bool {
        let is_number = matches!(value, Bson::Int32(_) | Bson::Int64(_) | Bson::Double(_) | Bson::Decimal128(_));
        match (self, value) {
            (Self::Bool | Self::Flag | Self::ObjectOrFlag, Bson::Boolean(_))
            | (Self::Text | Self::TextOrNumber | Self::OneOf(_), Bson::String(_))
            | (Self::Object | Self::ObjectOrFlag | Self::Of(..) | Self::With(_), Bson::Document(_))
            | (Self::Array, Bson::Array(_)) => true,
            (Self::Flag | Self::Number | Self::TextOrNumber | Self::ObjectOrFlag, _) => is_number,
            _ => false,
        }
    }

    /// Its name in messages.
    fn names(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::Flag => "[bool, long, int, decimal, double]",
            Self::Number => "[long, int, decimal, double]",
            Self::Text | Self::OneOf(_) => "string",
            Self::TextOrNumber => "[string, long]",
            Self::Object | Self::Of(..) | Self::With(_) => "object",
            Self::ObjectOrFlag => "[object, bool]",
            Self::Array => "array",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    const OPTIONS: Options = &[
        ("flag", Type::Flag),
        ("level", Type::OneOf(&["off", "on"])),
        ("images", Type::Of(Some("enabled"), &[("enabled", Type::Bool)])),
        ("series", Type::With("field")),
    ];

    #[test]
    fn options_are_checked_by_their_types() {
        let code = |body: Document| check("c", &body, OPTIONS).map_or_else(|failure| failure.code, |()| 0);
        for (body, expected) in [
            (doc! { "c": 1, "flag": 1.5, "level": "on", "images": { "enabled": true }, "$db": "a" }, 0),
            (doc! { "c": 1, "flag": Bson::Null, "level": Bson::Null }, 0),
            (doc! { "c": 1, "flag": "x" }, codes::TYPE_MISMATCH),
            (doc! { "c": 1, "level": 1 }, codes::TYPE_MISMATCH),
            (doc! { "c": 1, "level": "ON" }, codes::BAD_VALUE),
            (doc! { "c": 1, "images": {} }, codes::MISSING_FIELD),
            (doc! { "c": 1, "images": { "enabled": Bson::Null } }, codes::MISSING_FIELD),
            (doc! { "c": 1, "images": { "enabled": 1 } }, codes::TYPE_MISMATCH),
            (doc! { "c": 1, "images": { "enabled": true, "x": 1 } }, codes::UNKNOWN_FIELD),
            (doc! { "c": 1, "series": { "x": 1 } }, codes::MISSING_FIELD),
            (doc! { "c": 1, "x": 1 }, codes::UNKNOWN_FIELD),
        ] {
            assert_eq!(code(body.clone()), expected, "{body}");
        }
    }
}
