//! The functions that ask the memory, and the arguments of each.

use std::fmt;

use minijinja::{Error, ErrorKind};

use crate::formats::nearest;

/// A function with its arguments.
#[derive(Debug)]
pub(super) struct Signature {
    name: &'static str,
    /// By place or by name.
    arguments: &'static [&'static str],
    /// By name only.
    named: &'static [&'static str],
}

const FIND: &[&str] = &["sort", "projection", "skip", "limit"];

const SIGNATURES: [Signature; 5] = [
    Signature { name: "query", arguments: &["ns", "filter"], named: FIND },
    Signature { name: "find_one", arguments: &["ns", "filter"], named: FIND },
    Signature { name: "count", arguments: &["ns", "filter"], named: &[] },
    Signature { name: "distinct", arguments: &["ns", "field", "filter"], named: &[] },
    Signature { name: "aggregate", arguments: &["ns", "pipeline"], named: &[] },
];

/// Arguments of other tools, and what they are called here.
const SYNONYMS: [(&str, &str); 8] = [
    ("fields", "projection"),
    ("select", "projection"),
    ("project", "projection"),
    ("query", "filter"),
    ("where", "filter"),
    ("collection", "ns"),
    ("order", "sort"),
    ("offset", "skip"),
];

/// Returns the signature of a function.
pub(super) fn of(name: &str) -> Option<&'static Signature> {
    SIGNATURES.iter().find(|signature| signature.name == name)
}

impl Signature {
    /// Refuses arguments that the function does not have.
    pub(super) fn check<'a>(&self, given: impl Iterator<Item = &'a str>) -> Result<(), Error> {
        let known = || self.arguments.iter().chain(self.named).copied();
        let mut given = given;
        let Some(unknown) = given.find(|name| !known().any(|known| known == *name)) else { return Ok(()) };
        let synonym = SYNONYMS.iter().find(|(word, _)| *word == unknown).map(|(_, name)| *name);
        let meant = synonym.filter(|name| known().any(|known| known == *name)).or_else(|| nearest(unknown, known()));
        let meant = meant.map(|name| format!(", did you mean `{name}`?")).unwrap_or_default();
        let message = format!("unknown keyword argument `{unknown}`{meant}: {self}");
        Err(Error::new(ErrorKind::InvalidOperation, message))
    }
}

impl fmt::Display for Signature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = self.named.iter().map(|name| format!("{name}="));
        let arguments: Vec<String> = self.arguments.iter().map(|name| (*name).to_owned()).chain(named).collect();
        write!(f, "expected {}({})", self.name, arguments.join(", "))
    }
}
