//! Where documents live: `database.collection`.

use std::fmt;
use std::str::FromStr;

use crate::fault::{AtFault, Fault};

/// The collection of a pipeline that brings its own documents (`$documents`), by MongoDB's name for it.
#[cfg(any(feature = "mongodb", feature = "serve"))]
pub(crate) const NO_COLLECTION: &str = "$cmd.aggregate";

/// A database and a collection, split at the first dot.
///
/// The rules are MongoDB's: a database name has 1 to 63 bytes and none of
/// `/\. "$*<>:|?` or NUL; a collection name is not empty, has no NUL and no
/// `$`, and does not start with `system.`; the whole has at most 255 bytes.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Namespace {
    /// The database; decides between the local and the shared store.
    pub database: String,
    /// The collection; may itself contain dots.
    pub collection: String,
}

/// Why a text is not a namespace.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is not a namespace: {reason}; expected DATABASE.COLLECTION, like robmem.worldmodel")]
pub struct NamespaceError {
    text: String,
    reason: String,
}

impl AtFault for NamespaceError {
    fn fault(&self) -> Fault {
        Fault::Usage
    }
}

impl Namespace {
    /// Reads a namespace.
    ///
    /// # Errors
    /// Where a rule of MongoDB's names is broken.
    pub fn parse(text: &str) -> Result<Self, NamespaceError> {
        let refuse = |reason: &str| Err(NamespaceError { text: text.to_owned(), reason: reason.to_owned() });
        let Some((database, collection)) = text.split_once('.') else {
            return refuse("it has no dot");
        };
        if database.is_empty() {
            return refuse("the database name is empty");
        }
        if collection.is_empty() {
            return refuse("the collection name is empty");
        }
        if database.len() > 63 {
            return refuse("the database name is longer than 63 bytes");
        }
        if database.contains(|c| "/\\ \"$*<>:|?\0".contains(c)) {
            return refuse("the database name has one of the characters / \\ \" $ * < > : | ? or a blank");
        }
        if collection.contains(['$', '\0']) {
            return refuse("the collection name has a `$` or a NUL");
        }
        if collection.starts_with("system.") {
            return refuse("collections named `system.…` are the database's own");
        }
        if collection.starts_with('.') || collection.ends_with('.') || collection.contains("..") {
            return refuse("the collection name has an empty part");
        }
        if text.len() > 255 {
            return refuse("it is longer than 255 bytes");
        }
        Ok(Self { database: database.to_owned(), collection: collection.to_owned() })
    }
}

impl Namespace {
    /// Whether it is one of rmem's own collections: the cache of computables, the positions of
    /// watches. These are left out of lists of collections and of dumps of the whole memory.
    #[must_use]
    pub fn is_own(&self) -> bool {
        self.collection.starts_with("rmem.")
    }
}

/// Whether a database is one of a MongoDB server's own.
#[must_use]
pub fn is_internal(database: &str) -> bool {
    matches!(database, "admin" | "config" | "local")
}

impl FromStr for Namespace {
    type Err = NamespaceError;

    /// Reads a namespace that a person wrote: of letters, digits, `_`, `-`, `/` and `.`, although MongoDB allows more. So a
    /// line of another tool, like `db.orders.find({})`, names no collection.
    ///
    /// # Errors
    /// Where it has another character, or a rule of MongoDB's names is broken.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let is_allowed = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '/' | '.');
        let reason = match text.chars().find(|c| !is_allowed(*c)) {
            None => return Self::parse(text),
            Some(c) if c.is_whitespace() => "it has a blank".to_owned(),
            Some(c) if c.is_control() => "it has a control character".to_owned(),
            Some(c) => format!("it has a `{c}`"),
        };
        Err(NamespaceError { text: text.to_owned(), reason })
    }
}

impl fmt::Display for Namespace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.database, self.collection)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splits_at_the_first_dot() {
        let ns: Namespace = "robmem.world.model".parse().unwrap();
        assert_eq!((ns.database.as_str(), ns.collection.as_str()), ("robmem", "world.model"));
        assert_eq!(ns.to_string(), "robmem.world.model");
    }

    #[test]
    fn a_person_writes_letters_digits_and_a_few_signs() {
        for text in ["robmem.worldmodel", "robmem.rooms-2.west_wing", "robmem.räume"] {
            assert_eq!(text.parse::<Namespace>().unwrap().to_string(), text);
        }
        for (text, reason) in [
            ("db.orders.find({team:'CYAN'})", "it has a `(`"),
            ("robmem.my orders", "it has a blank"),
            ("robmem.a\u{7}", "it has a control character"),
            ("robmem", "it has no dot"),
        ] {
            assert!(text.parse::<Namespace>().unwrap_err().to_string().contains(reason), "{text}");
        }
        assert!(Namespace::parse("robmem.my orders").is_ok(), "what a store has is not refused");
    }

    #[test]
    fn refuses_what_mongodb_refuses() {
        for text in ["", "robmem", ".x", "x.", "a b.c", "a$.c", "a.$c", "a.system.", "a.system.x", "a..b", "a.b\0"] {
            assert!(Namespace::parse(text).is_err(), "{text:?}");
        }
        assert!(Namespace::parse(&format!("{}.c", "d".repeat(64))).is_err());
    }
}
