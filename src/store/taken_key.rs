//! A unique key that is taken.

use std::fmt;

use bson::{Bson, Document, doc};

use crate::formats::{Source, shell};

/// A unique key that is taken: its values, and its index.
#[derive(Debug, Clone, PartialEq)]
pub struct TakenKey(Box<Parts>);

#[derive(Debug, Clone, PartialEq)]
struct Parts {
    /// The index; none for that of `_id`s.
    index: Option<String>,
    /// Empty where the server's text cannot be read.
    values: Document,
    /// As messages have the values.
    text: String,
}

impl TakenKey {
    /// Returns the key of an `_id`.
    #[must_use]
    pub fn id(id: &Bson) -> Self {
        Self::on(doc! { "_id": id })
    }

    /// Returns the key of these values, of no index by name.
    #[must_use]
    pub fn on(values: Document) -> Self {
        Self::new(None, values)
    }

    /// Returns the key of these values, by path, in an index.
    #[must_use]
    pub fn of_index(index: &str, values: Document) -> Self {
        Self::new(Some(index), values)
    }

    fn new(index: Option<&str>, values: Document) -> Self {
        let text = values.iter().map(|(path, value)| format!("{path}: {value}")).collect::<Vec<_>>().join(", ");
        Self(Box::new(Parts { index: index.map(str::to_owned), values, text }))
    }

    /// Returns the key that a server's message has as a text, with its values where they can be read.
    #[must_use]
    pub fn spelled(index: Option<&str>, text: &str) -> Self {
        let source = Source::new("<key>", format!("{{{text}}}"));
        let values = shell::parse_document(&source).unwrap_or_default();
        Self(Box::new(Parts { index: index.map(str::to_owned), values, text: text.to_owned() }))
    }

    /// The name of the index; none for that of `_id`s.
    #[must_use]
    pub fn index(&self) -> Option<&str> {
        self.0.index.as_deref()
    }

    /// The values, by path; none where they are not known.
    #[must_use]
    pub fn values(&self) -> &Document {
        &self.0.values
    }

    /// The values as messages have them, like `name: "x", n: 7`.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.0.text
    }
}

impl fmt::Display for TakenKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.index() {
            Some(index) => write!(f, "{} (unique index {index})", self.text()),
            None => f.write_str(self.text()),
        }
    }
}
