//! The options of a collation.

use bson::{Bson, Document, doc};

use super::locale;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;

/// The error codes of MongoDB for a collation.
const MISSING: i32 = 40_414;
const UNKNOWN: i32 = 40_415;
const TOO_LARGE: i32 = 51_024;

/// The options of a collation, by the values they may have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Options {
    pub(super) locale: String,
    /// From 1, base letters only, to 5, all that differs.
    pub(super) strength: u8,
    pub(super) case_level: bool,
    pub(super) case_first: String,
    pub(super) numeric: bool,
    pub(super) shifted: bool,
    pub(super) max_variable: String,
    /// Accents compare from the end of a string on, as in Canadian French.
    pub(super) backwards: bool,
}

impl Options {
    pub(super) fn parse(spec: &Document) -> Result<Self> {
        let mut options = Self {
            locale: String::new(),
            strength: 3,
            case_level: false,
            case_first: "off".to_owned(),
            numeric: false,
            shifted: false,
            max_variable: "punct".to_owned(),
            backwards: spec.get_str("locale").is_ok_and(|locale| locale == "fr_CA"),
        };
        for (name, value) in spec.iter().filter(|(_, value)| !matches!(value, Bson::Null | Bson::Undefined)) {
            match name.as_str() {
                "locale" => text(name, value)?.clone_into(&mut options.locale),
                "strength" => options.strength = strength(value)?,
                "caseLevel" => options.case_level = flag(name, value)?,
                "caseFirst" => options.case_first = one_of(name, value, &["off", "upper", "lower"])?,
                "numericOrdering" => options.numeric = flag(name, value)?,
                "alternate" => {
                    options.shifted = one_of(name, value, &["non-ignorable", "shifted"])? == "shifted";
                }
                "maxVariable" => options.max_variable = one_of(name, value, &["punct", "space"])?,
                // Strings are normalized in any case.
                "normalization" => drop(flag(name, value)?),
                "backwards" => options.backwards = flag(name, value)?,
                "version" => drop(text(name, value)?),
                _ => {
                    return Err(QueryError::invalid(UNKNOWN, format!("'collation.{name}' is an unknown field")));
                }
            }
        }
        if !spec.contains_key("locale") {
            return Err(QueryError::invalid(MISSING, "a collation needs a `locale`, like {locale: 'en'}"));
        }
        locale::check(&options.locale)?;
        Ok(options)
    }

    pub(super) fn definition(&self) -> Document {
        doc! {
            "locale": &self.locale,
            "caseLevel": self.case_level,
            "caseFirst": &self.case_first,
            "strength": i32::from(self.strength),
            "numericOrdering": self.numeric,
            "alternate": if self.shifted { "shifted" } else { "non-ignorable" },
            "maxVariable": &self.max_variable,
            "normalization": false,
            "backwards": self.backwards,
        }
    }
}

fn text<'a>(name: &str, value: &'a Bson) -> Result<&'a str> {
    value.as_str().ok_or_else(|| QueryError::type_mismatch(format!("the `{name}` of a collation must be a string")))
}

fn flag(name: &str, value: &Bson) -> Result<bool> {
    value
        .as_bool()
        .ok_or_else(|| QueryError::type_mismatch(format!("the `{name}` of a collation must be true or false")))
}

fn one_of(name: &str, value: &Bson, values: &[&str]) -> Result<String> {
    let value = text(name, value)?;
    match values.contains(&value) {
        true => Ok(value.to_owned()),
        false => {
            let message = format!("the `{name}` of a collation is one of {}, not {value:?}", values.join(", "));
            Err(QueryError::bad_value(message))
        }
    }
}

fn strength(value: &Bson) -> Result<u8> {
    let number =
        Number::of(value).ok_or_else(|| QueryError::type_mismatch("the `strength` of a collation must be a number"))?;
    // A fraction is cut off, and that of a decimal is rounded.
    match number.coerced() {
        strength @ 1..=5 => Ok(u8::try_from(strength).unwrap_or(3)),
        6.. => Err(QueryError::invalid(TOO_LARGE, "the `strength` of a collation is at most 5")),
        _ => Err(QueryError::bad_value("the `strength` of a collation is a whole number from 1 to 5")),
    }
}
