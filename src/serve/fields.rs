//! The fields of a command, by the types MongoDB takes them in.

use bson::{Bson, Document, Timestamp};

use super::failure::{Failure, codes};
use crate::query::{Collation, type_name};
use crate::store::{Hint, Modifiers};

/// Fields that every command may have.
const GENERIC: [&str; 20] = [
    "$audit",
    "$client",
    "$clusterTime",
    "$configServerState",
    "$configTime",
    "$db",
    "$queryOptions",
    "$readPreference",
    "apiDeprecationErrors",
    "apiStrict",
    "apiVersion",
    "autocommit",
    "clientOperationKey",
    "comment",
    "lsid",
    "maxTimeMS",
    "readConcern",
    "startTransaction",
    "txnNumber",
    "writeConcern",
];

/// Whether every command may have a field.
pub(super) fn is_generic(name: &str) -> bool {
    GENERIC.contains(&name)
}

/// A number as MongoDB writes it in replies: of 32 bits where it fits.
pub(super) fn number(value: i64) -> Bson {
    i32::try_from(value).map_or(Bson::Int64(value), Bson::Int32)
}

/// The fields of a command, or of a document in one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fields<'a> {
    /// What messages call it.
    pub(super) of: &'a str,
    pub(super) document: &'a Document,
}

impl<'a> Fields<'a> {
    pub(super) fn new(of: &'a str, document: &'a Document) -> Self {
        Self { of, document }
    }

    /// Refuses what this rmem has no word for: fields by their names, where they are not as if left out.
    pub(super) fn refuse(self, unsupported: &[&str]) -> Result<(), Failure> {
        let is_said = |name: &&&str| {
            self.document.get(**name).is_some_and(|value| match value {
                Bson::Null | Bson::Boolean(false) => false,
                Bson::Document(inner) => !inner.is_empty(),
                _ => true,
            })
        };
        match unsupported.iter().find(is_said) {
            Some(name) => Err(Failure::unsupported(&format!("the option `{name}` of {}", self.of))),
            None => Ok(()),
        }
    }

    /// Refuses fields that MongoDB does not know.
    pub(super) fn known(self, names: &[&str]) -> Result<(), Failure> {
        let mut rest = self.document.keys().skip(1).map(String::as_str);
        self.only(rest.find(|name| !names.contains(name) && !GENERIC.contains(name)))
    }

    /// Takes some fields, and refuses those that MongoDB knows and this rmem has no word for.
    pub(super) fn check(self, taken: &[&str], refused: &[&str]) -> Result<(), Failure> {
        self.known(&[taken, refused].concat())?;
        self.refuse(refused)
    }

    /// Refuses fields that MongoDB does not know in a document of a command.
    pub(super) fn known_inside(self, names: &[&str]) -> Result<(), Failure> {
        self.only(self.document.keys().map(String::as_str).find(|name| !names.contains(name)))
    }

    fn only(self, unknown: Option<&str>) -> Result<(), Failure> {
        match unknown {
            Some(name) => {
                let message = format!("BSON field '{}.{name}' is an unknown field.", self.of);
                Err(Failure::malformed(codes::UNKNOWN_FIELD, message))
            }
            None => Ok(()),
        }
    }

    /// What the command says beside its query: `collation`, `let` and `hint`.
    pub(super) fn modifiers(self) -> Result<Modifiers, Failure> {
        let collation = self.document("collation")?.filter(|collation| !collation.is_empty());
        let hint = match self.document.get("hint") {
            Some(hint) => Hint::parse(hint)?,
            None => None,
        };
        Ok(Modifiers {
            collation: collation.map(Collation::parse).transpose()?,
            variables: self.document_or_empty("let")?,
            hint,
        })
    }

    fn get(self, name: &str) -> Option<&'a Bson> {
        self.document.get(name).filter(|value| !matches!(value, Bson::Null | Bson::Undefined))
    }

    pub(super) fn wrong(self, name: &str, value: &Bson, expected: &str) -> Failure {
        let found = type_name(value);
        let message =
            format!("BSON field '{}.{name}' is the wrong type '{found}', expected type '{expected}'", self.of);
        Failure::malformed(codes::TYPE_MISMATCH, message)
    }

    pub(super) fn missing(self, name: &str) -> Failure {
        let message = format!("BSON field '{}.{name}' is missing but a required field", self.of);
        Failure::malformed(codes::MISSING_FIELD, message)
    }

    pub(super) fn document(self, name: &str) -> Result<Option<&'a Document>, Failure> {
        match self.get(name) {
            None => Ok(None),
            Some(Bson::Document(document)) => Ok(Some(document)),
            Some(other) => Err(self.wrong(name, other, "object")),
        }
    }

    /// The document, or an empty one.
    pub(super) fn document_or_empty(self, name: &str) -> Result<Document, Failure> {
        Ok(self.document(name)?.cloned().unwrap_or_default())
    }

    pub(super) fn array(self, name: &str) -> Result<Option<&'a [Bson]>, Failure> {
        match self.get(name) {
            None => Ok(None),
            Some(Bson::Array(values)) => Ok(Some(values)),
            Some(other) => Err(self.wrong(name, other, "array")),
        }
    }

    pub(super) fn documents(self, name: &str) -> Result<Option<Vec<&'a Document>>, Failure> {
        let Some(values) = self.array(name)? else { return Ok(None) };
        let document = |(index, value): (usize, &'a Bson)| match value {
            Bson::Document(document) => Ok(document),
            other => Err(self.wrong(&format!("{name}.{index}"), other, "object")),
        };
        values.iter().enumerate().map(document).collect::<Result<_, _>>().map(Some)
    }

    pub(super) fn text(self, name: &str) -> Result<Option<&'a str>, Failure> {
        match self.get(name) {
            None => Ok(None),
            Some(Bson::String(text)) => Ok(Some(text)),
            Some(other) => Err(self.wrong(name, other, "string")),
        }
    }

    /// A whole number, of any type.
    pub(super) fn whole(self, name: &str) -> Result<Option<i64>, Failure> {
        match self.get(name) {
            None => Ok(None),
            Some(value) => match whole(value) {
                Some(number) => Ok(Some(number)),
                None => Err(self.wrong(name, value, "long")),
            },
        }
    }

    /// A number of 32 bits, and of no other type.
    pub(super) fn int(self, name: &str) -> Result<Option<i32>, Failure> {
        match self.get(name) {
            None => Ok(None),
            Some(Bson::Int32(number)) => Ok(Some(*number)),
            Some(other) => Err(self.wrong(name, other, "int")),
        }
    }

    /// Numbers of 32 bits, and of no other type.
    pub(super) fn ints(self, name: &str) -> Result<Option<Vec<i32>>, Failure> {
        let Some(values) = self.array(name)? else { return Ok(None) };
        let int = |(index, value): (usize, &Bson)| match value {
            Bson::Int32(number) => Ok(*number),
            other => Err(self.wrong(&format!("{name}.{index}"), other, "int")),
        };
        values.iter().enumerate().map(int).collect::<Result<_, _>>().map(Some)
    }

    /// A whole number that is not negative.
    pub(super) fn size(self, name: &str) -> Result<Option<u64>, Failure> {
        let Some(number) = self.whole(name)? else { return Ok(None) };
        u64::try_from(number).map(Some).map_err(|_| {
            let message = format!("BSON field '{name}' value must be >= 0, actual value '{number}'");
            Failure::new(51_024, message)
        })
    }

    pub(super) fn flag(self, name: &str) -> Result<bool, Failure> {
        Ok(self.optional_flag(name)?.unwrap_or(false))
    }

    /// A flag that may be nothing but true or false: no number. Null is none.
    pub(super) fn boolean(self, name: &str) -> Result<Option<bool>, Failure> {
        match self.get(name) {
            None => Ok(None),
            Some(Bson::Boolean(value)) => Ok(Some(*value)),
            Some(other) => Err(self.wrong(name, other, "bool")),
        }
    }

    /// A flag that may be nothing but true or false, where it is given: not null, and no number.
    pub(super) fn strict_flag(self, name: &str) -> Result<bool, Failure> {
        match self.document.get(name) {
            None => Ok(false),
            Some(Bson::Boolean(value)) => Ok(*value),
            Some(other) => {
                let message =
                    format!("Field '{}.{name}' should be a boolean value, but found: {}", self.of, type_name(other));
                Err(Failure::new(codes::TYPE_MISMATCH, message))
            }
        }
    }

    /// A moment of the cluster's clock, where it is given: not null.
    pub(super) fn timestamp(self, name: &str) -> Result<Option<Timestamp>, Failure> {
        match self.document.get(name) {
            None => Ok(None),
            Some(Bson::Timestamp(moment)) => Ok(Some(*moment)),
            Some(other) => Err(self.wrong(name, other, "timestamp")),
        }
    }

    pub(super) fn optional_flag(self, name: &str) -> Result<Option<bool>, Failure> {
        match self.get(name) {
            None => Ok(None),
            Some(Bson::Boolean(value)) => Ok(Some(*value)),
            Some(value @ (Bson::Int32(_) | Bson::Int64(_) | Bson::Double(_) | Bson::Decimal128(_))) => {
                Ok(Some(!crate::query::compare_values(value, &Bson::Int32(0)).is_eq()))
            }
            Some(other) => Err(self.wrong(name, other, "bool")),
        }
    }
}

/// A number as the `i64` that MongoDB takes it as: a double without its fraction, a decimal rounded to the even
/// neighbour, what is none as 0, and what is too large as the largest.
pub(super) fn whole(value: &Bson) -> Option<i64> {
    match value {
        Bson::Int32(number) => Some((*number).into()),
        Bson::Int64(number) => Some(*number),
        #[expect(clippy::cast_possible_truncation, reason = "MongoDB cuts numbers that are too large, too")]
        Bson::Double(number) => Some(*number as i64),
        #[expect(clippy::cast_possible_truncation, reason = "as above")]
        Bson::Decimal128(number) => {
            number.to_string().parse::<f64>().ok().map(|number| number.round_ties_even() as i64)
        }
        _ => None,
    }
}

/// The same, where the number is whole already.
pub(super) fn integral(value: &Bson) -> Option<i64> {
    whole(value).filter(|whole| crate::query::compare_values(value, &Bson::Int64(*whole)).is_eq())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn numbers_of_every_type_are_whole_numbers() {
        let document = doc! { "find": "c", "a": 3_i64, "b": 3.7, "c": "x", "d": -1, "e": Bson::Null };
        let fields = Fields::new("find", &document);
        assert_eq!((fields.whole("a").unwrap(), fields.whole("b").unwrap()), (Some(3), Some(3)));
        assert_eq!(fields.whole("c").unwrap_err().code, codes::TYPE_MISMATCH);
        assert_eq!(fields.size("d").unwrap_err().code, 51_024);
        assert_eq!(fields.size("e").unwrap(), None);
        let decimal = |text: &str| Bson::Decimal128(text.parse().unwrap());
        for (value, whole) in [
            (decimal("1.5"), 2),
            (decimal("2.5"), 2),
            (decimal("NaN"), 0),
            (decimal("Infinity"), i64::MAX),
            (f64::NAN.into(), 0),
            (f64::INFINITY.into(), i64::MAX),
        ] {
            assert_eq!(super::whole(&value), Some(whole), "{value}");
            assert_eq!(integral(&value), None, "{value}");
        }
        assert_eq!((integral(&2.0.into()), integral(&decimal("3"))), (Some(2), Some(3)));
    }

    #[test]
    fn unknown_fields_and_unsupported_options_are_named() {
        let document = doc! { "find": "c", "$db": "d", "hunt": 1 };
        let refusal = Fields::new("find", &document).known(&["filter"]).unwrap_err();
        assert_eq!(refusal.message, "BSON field 'find.hunt' is an unknown field.");
        let document = doc! { "find": "c", "tailable": true };
        let fields = Fields::new("find", &document);
        assert!(fields.modifiers().unwrap().is_empty());
        assert_eq!(fields.refuse(&["tailable"]).unwrap_err().code, codes::NOT_SUPPORTED);
    }
}
