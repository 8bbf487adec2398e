//! What keeps documents from meeting a condition.

use std::fmt;

use bson::{Bson, Document, doc};

use crate::formats::shell;

/// What keeps documents from meeting a condition.
#[derive(Debug, Clone, PartialEq)]
pub enum Remark {
    /// No document has the key.
    NoKey {
        /// The key, or a dotted path.
        path: String,
        /// A key like it, and how many documents have that.
        nearest: Option<(String, u64)>,
        /// Keys that documents have, where none is like it.
        known: Vec<String>,
    },
    /// No document has the key in the document, or other value, that it would be in.
    NoInner {
        /// The dotted path.
        path: String,
        /// The path before its last key.
        parent: String,
        /// The types of the values there, and how many documents have each.
        types: Vec<(&'static str, u64)>,
        /// The keys of documents there.
        keys: Vec<String>,
    },
    /// A document is compared as a whole; its parts would match.
    Whole {
        /// The key, or a dotted path.
        path: String,
        /// The query for the parts.
        parts: Document,
        /// How many documents match that.
        documents: u64,
    },
    /// A document of names that are operators without their `$`.
    NoDollar {
        /// The query with operators.
        query: Document,
        /// How many documents match that.
        documents: u64,
    },
    /// The documents have values of other types.
    OtherType {
        /// The key, or a dotted path.
        path: String,
        /// How many documents have the key.
        documents: u64,
        /// The types, and how many documents have each.
        types: Vec<(&'static str, u64)>,
        /// The type that the condition compares with.
        wanted: &'static str,
    },
    /// A value like that of the condition, which documents have.
    OtherValue {
        /// The key, or a dotted path.
        path: String,
        /// The value that they have.
        value: Bson,
        /// How many have it.
        documents: u64,
    },
}

/// The types that values of documents may have: the name in messages, with its article, and MongoDB's alias.
pub(super) const TYPES: [(&str, &str); 9] = [
    ("an array", "array"),
    ("a string", "string"),
    ("a number", "number"),
    ("true or false", "bool"),
    ("a date", "date"),
    ("an ObjectId", "objectId"),
    ("a document", "object"),
    ("null", "null"),
    ("binary data", "binData"),
];

/// Returns the name of the type with which a value is compared; none where types play no role.
pub(super) fn type_of(value: &Bson) -> Option<&'static str> {
    Some(match value {
        Bson::Array(_) => "an array",
        Bson::String(_) | Bson::Symbol(_) | Bson::RegularExpression(_) => "a string",
        Bson::Int32(_) | Bson::Int64(_) | Bson::Double(_) | Bson::Decimal128(_) => "a number",
        Bson::Boolean(_) => "true or false",
        Bson::DateTime(_) => "a date",
        Bson::ObjectId(_) => "an ObjectId",
        Bson::Document(_) => "a document",
        Bson::Binary(_) => "binary data",
        _ => return None,
    })
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoKey { path, nearest: Some((nearest, documents)), .. } => {
                let verb = if *documents == 1 { "has" } else { "have" };
                write!(f, "no document has the key `{path}`; {documents} {verb} `{nearest}`")
            }
            Self::NoKey { path, nearest: None, known } if known.is_empty() => {
                write!(f, "no document has the key `{path}`")
            }
            Self::NoKey { path, nearest: None, known } => {
                write!(f, "no document has the key `{path}`; there are {}", known.join(", "))
            }
            Self::NoInner { path, parent, types, keys } => {
                let types = types.iter().map(|(name, number)| format!("{name} in {}", count(*number)));
                let types = types.collect::<Vec<_>>().join(", ");
                write!(f, "no document has the key `{path}`; {parent} is {types}")?;
                if keys.is_empty() { Ok(()) } else { write!(f, ", with the keys {}", keys.join(", ")) }
            }
            Self::Whole { path, parts, documents } => {
                write!(f, "{path} is compared as a whole, with all its keys in their order; ")?;
                write!(f, "{} matches {}", shell::typed(&Bson::Document(parts.clone())), count(*documents))
            }
            Self::NoDollar { query, documents } => {
                let query = shell::typed(&Bson::Document(query.clone()));
                write!(f, "did you mean {query}? It matches {}", count(*documents))
            }
            Self::OtherType { path, documents, types, wanted } => {
                write!(f, "{path} is {}; you compare with {wanted}", types_text(types, *documents))
            }
            Self::OtherValue { path, value, documents } => {
                let query = doc! { path: value.clone() };
                write!(f, "{} matches {}", shell::typed(&Bson::Document(query)), count(*documents))
            }
        }
    }
}

fn types_text(types: &[(&str, u64)], documents: u64) -> String {
    if let [(name, number)] = types
        && *number == documents
    {
        return match documents {
            1 => format!("{name} in the one document that has it"),
            _ => format!("{name} in all {}", count(documents)),
        };
    }
    types.iter().map(|(name, number)| format!("{name} in {}", count(*number))).collect::<Vec<_>>().join(", ")
}

pub(super) fn count(documents: u64) -> String {
    if documents == 1 { "1 document".to_owned() } else { format!("{documents} documents") }
}
