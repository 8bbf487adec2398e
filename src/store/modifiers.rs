//! What a command says of an operation beside its query: how strings compare, variables, and which index is read.

use std::sync::LazyLock;

use bson::{Bson, Document};

use crate::query::{Collation, QueryError, QueryMistake, compare_values};

/// What a command says beside its query.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Modifiers {
    /// How strings compare; without one, byte by byte.
    pub collation: Option<Collation>,
    /// Variables that expressions can use as `$$name` (MongoDB's `let`).
    pub variables: Document,
    /// The index to be read, whatever seems better.
    pub hint: Option<Hint>,
}

/// An index that is to be read.
#[derive(Debug, Clone, PartialEq)]
pub enum Hint {
    /// That of this name.
    Name(String),
    /// That with these keys.
    Keys(Document),
    /// None: all documents, in the order of insertion.
    Natural {
        /// The last one first.
        backwards: bool,
    },
}

impl Modifiers {
    /// Those that say nothing.
    #[must_use]
    pub fn none() -> &'static Self {
        static NONE: LazyLock<Modifiers> = LazyLock::new(Modifiers::default);
        &NONE
    }

    /// Whether nothing is said.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.collation.is_none() && self.variables.is_empty() && self.hint.is_none()
    }

    /// The same without the index: for what looks for other documents.
    #[must_use]
    pub fn without_hint(&self) -> Self {
        Self { hint: None, ..self.clone() }
    }
}

impl Hint {
    /// Reads a hint: the name of an index, its keys, or `{$natural: ±1}`; an empty one says nothing.
    ///
    /// # Errors
    /// If it is something else.
    pub fn parse(hint: &Bson) -> Result<Option<Self>, QueryError> {
        match hint {
            Bson::String(name) => Ok(Some(Self::Name(name.clone()))),
            Bson::Document(keys) if keys.is_empty() => Ok(None),
            Bson::Document(keys) => match keys.get("$natural") {
                None => Ok(Some(Self::Keys(keys.clone()))),
                Some(_) if keys.len() > 1 => Err(QueryError::bad_value("a hint with $natural has no other key")
                    .about("$natural")
                    .of_kind(QueryMistake::Hint)),
                Some(direction) => {
                    let backwards = compare_values(direction, &Bson::Int32(0)).is_lt();
                    Ok(Some(Self::Natural { backwards }))
                }
            },
            _ => {
                Err(QueryError::failed_to_parse("a hint is the name or the keys of an index")
                    .of_kind(QueryMistake::Hint))
            }
        }
    }

    /// The hint as MongoDB takes it.
    #[must_use]
    pub fn to_bson(&self) -> Bson {
        match self {
            Self::Name(name) => Bson::from(name.as_str()),
            Self::Keys(keys) => Bson::Document(keys.clone()),
            Self::Natural { backwards } => Bson::Document(bson::doc! { "$natural": if *backwards { -1 } else { 1 } }),
        }
    }
}
