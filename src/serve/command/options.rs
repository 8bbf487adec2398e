//! The options of commands by the types that MongoDB takes them in.

use std::fmt::Display;

use bson::{Bson, Document};

use crate::query::type_name;
use crate::serve::failure::{Failure, codes};
use crate::serve::fields::{is_generic, whole};

/// What an option may be. Null is as if it were left out, unless a type says otherwise.
#[derive(Debug, Clone, Copy)]
pub(super) enum Type {
    /// Anything: who reads it checks it.
    Any,
    /// True or false.
    Bool,
    /// The same, and not null.
    Strict,
    /// True or false, or a number that stands for it.
    Flag,
    Number,
    /// A number that is at least this without its fraction, and below the other.
    Within(i64, i64),
    Text,
    /// One of these texts.
    OneOf(&'static [&'static str]),
    Object,
    /// A document with these options, of which some have to be there.
    Of(&'static [&'static str], Options),
    /// An array of documents, and not null.
    Objects,
    /// One or the other.
    Either(&'static Type, &'static Type),
    /// Of this type, and not null.
    Given(&'static Type),
}

/// Options by name.
pub(super) type Options = &'static [(&'static str, Type)];

/// MongoDB's code for null instead of an array of documents.
const NO_ARRAY: i32 = 10_065;
/// MongoDB's code for a number that is too small or too large.
const OUT_OF_RANGE: i32 = 51_024;

/// Checks the options of a command.
///
/// # Errors
/// If MongoDB does not know one, or takes it in another type.
pub(super) fn check(command: &str, body: &Document, options: Options) -> Result<(), Failure> {
    body.iter().skip(1).filter(|(name, _)| !is_generic(name)).try_for_each(|given| check_one(&command, given, options))
}

/// Checks the options in a document of a command.
///
/// # Errors
/// As [`check`].
pub(super) fn check_inside(of: &str, document: &Document, options: Options) -> Result<(), Failure> {
    check_at(&of, document, options)
}

fn check_at(of: &dyn Display, document: &Document, options: Options) -> Result<(), Failure> {
    document.iter().try_for_each(|given| check_one(of, given, options))
}

/// Whether an option of this name is known.
pub(super) fn is_known(options: Options, name: &str) -> bool {
    options.iter().any(|(known, _)| *known == name)
}

fn check_one(of: &dyn Display, (name, value): (&String, &Bson), options: Options) -> Result<(), Failure> {
    match options.iter().find(|(known, _)| known == name) {
        Some((_, wanted)) => wanted.check(&format_args!("{of}.{name}"), value),
        None => {
            let message = format!("BSON field '{of}.{name}' is an unknown field.");
            Err(Failure::malformed(codes::UNKNOWN_FIELD, message))
        }
    }
}

fn check_needed(place: &dyn Display, document: &Document, name: &str) -> Result<(), Failure> {
    match document.get(name) {
        None | Some(Bson::Null | Bson::Undefined) => {
            let message = format!("BSON field '{place}.{name}' is missing but a required field");
            Err(Failure::malformed(codes::MISSING_FIELD, message))
        }
        Some(_) => Ok(()),
    }
}

impl Type {
    /// Checks the option at a place of a command, which is written only where something is wrong.
    fn check(self, place: &dyn Display, value: &Bson) -> Result<(), Failure> {
        let is_null = matches!(value, Bson::Null | Bson::Undefined);
        match (self, value) {
            (Self::Given(inner), _) if !is_null => inner.check(place, value),
            (Self::Objects, _) if is_null => {
                Err(Failure::new(NO_ARRAY, format!("invalid parameter: expected an object ({})", name_at(place))))
            }
            (Self::Given(_) | Self::Strict, _) if is_null => Err(self.wrong(place, value)),
            _ if is_null => Ok(()),
            _ if !self.takes(value) => Err(self.wrong(place, value)),
            (Self::Either(one, other), _) => if one.takes(value) { one } else { other }.check(place, value),
            (Self::Within(least, end), _) => check_range(place, whole(value).unwrap_or_default(), (least, end)),
            (Self::OneOf(values), Bson::String(text)) if !values.contains(&text.as_str()) => {
                let message = format!("Enumeration value '{text}' for field '{place}' is not a valid value.");
                Err(Failure::new(codes::BAD_VALUE, message))
            }
            (Self::Of(needed, inner), Bson::Document(document)) => {
                check_at(place, document, inner)?;
                needed.iter().try_for_each(|needed| check_needed(place, document, needed))
            }
            (Self::Objects, Bson::Array(values)) => values
                .iter()
                .enumerate()
                .filter(|(_, value)| !matches!(value, Bson::Document(_)))
                .try_for_each(|(nth, value)| Err(Self::Object.wrong(&format_args!("{place}.{nth}"), value))),
            _ => Ok(()),
        }
    }

    /// Whether it is of the type, whatever is in it.
    fn takes(self, value: &Bson) -> bool {
        match (self, value) {
            (Self::Any, _)
            | (Self::Bool | Self::Strict | Self::Flag, Bson::Boolean(_))
            | (Self::Text | Self::OneOf(_), Bson::String(_))
            | (Self::Object | Self::Of(..), Bson::Document(_))
            | (Self::Objects, Bson::Array(_)) => true,
            (Self::Flag | Self::Number | Self::Within(..), _) => whole(value).is_some(),
            (Self::Either(one, other), _) => one.takes(value) || other.takes(value),
            (Self::Given(inner), _) => inner.takes(value),
            _ => false,
        }
    }

    fn wrong(self, place: &dyn Display, value: &Bson) -> Failure {
        let found = type_name(value);
        if let Self::Strict = self {
            let message = format!("Field '{place}' should be a boolean value, but found: {found}");
            return Failure::new(codes::TYPE_MISMATCH, message);
        }
        let expected = match self.names().as_slice() {
            [name] => format!("type '{name}'"),
            names => format!("types '[{}]'", names.join(", ")),
        };
        let message = format!("BSON field '{place}' is the wrong type '{found}', expected {expected}");
        Failure::malformed(codes::TYPE_MISMATCH, message)
    }

    /// What it is called in messages.
    fn names(self) -> Vec<&'static str> {
        match self {
            Self::Any => vec!["any"],
            Self::Bool | Self::Strict => vec!["bool"],
            Self::Flag => vec!["bool", "long", "int", "decimal", "double"],
            Self::Number | Self::Within(..) => vec!["long", "int", "decimal", "double"],
            Self::Text | Self::OneOf(_) => vec!["string"],
            Self::Object | Self::Of(..) => vec!["object"],
            Self::Objects => vec!["array"],
            Self::Either(one, other) => [one.names(), other.names()].concat(),
            Self::Given(inner) => inner.names(),
        }
    }
}

/// The last part of a place.
fn name_at(place: &dyn Display) -> String {
    let place = place.to_string();
    place.rsplit('.').next().map_or_else(String::new, str::to_owned)
}

fn check_range(place: &dyn Display, number: i64, (least, end): (i64, i64)) -> Result<(), Failure> {
    let limit = match number {
        _ if number < least => format!(">= {least}"),
        _ if number >= end => format!("< {end}"),
        _ => return Ok(()),
    };
    let name = name_at(place);
    Err(Failure::new(OUT_OF_RANGE, format!("BSON field '{name}' value must be {limit}, actual value '{number}'")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    const OPTIONS: Options = &[
        ("flag", Type::Flag),
        ("level", Type::OneOf(&["off", "on"])),
        ("images", Type::Of(&["enabled"], &[("enabled", Type::Bool)])),
        ("stages", Type::Objects),
        ("strict", Type::Strict),
        ("size", Type::Within(1, 1 << 31)),
        ("either", Type::Given(&Type::Either(&Type::Text, &Type::Of(&["field"], &[("field", Type::Any)])))),
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
            (doc! { "c": 1, "stages": [{}], "strict": false, "size": 1.5, "either": { "field": 1 } }, 0),
            (doc! { "c": 1, "stages": Bson::Null }, NO_ARRAY),
            (doc! { "c": 1, "stages": [{}, 1] }, codes::TYPE_MISMATCH),
            (doc! { "c": 1, "strict": Bson::Null }, codes::TYPE_MISMATCH),
            (doc! { "c": 1, "strict": 1 }, codes::TYPE_MISMATCH),
            (doc! { "c": 1, "size": 0.5 }, OUT_OF_RANGE),
            (doc! { "c": 1, "size": 1_i64 << 31 }, OUT_OF_RANGE),
            (doc! { "c": 1, "size": "x" }, codes::TYPE_MISMATCH),
            (doc! { "c": 1, "either": Bson::Null }, codes::TYPE_MISMATCH),
            (doc! { "c": 1, "either": 1 }, codes::TYPE_MISMATCH),
            (doc! { "c": 1, "either": {} }, codes::MISSING_FIELD),
            (doc! { "c": 1, "x": 1 }, codes::UNKNOWN_FIELD),
        ] {
            assert_eq!(code(body.clone()), expected, "{body}");
        }
    }
}
