//! What rmem is given: texts from files and stdin, and the two ways in which they are wrong.

use crate::formats::{Diagnostic, Source};

/// The command line asks for something that makes no sense.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(String);

impl UsageError {
    /// Says what was wrong and what was expected.
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

/// An input is wrong as a whole, at no single place.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct WrongInput(String);

impl WrongInput {
    /// Says what was wrong and what was expected.
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

/// An input that cannot be read, whatever the reason, is bad input.
pub(crate) fn unreadable(name: &str, error: &std::io::Error) -> WrongInput {
    WrongInput::new(format!("cannot read {name}: {error}"))
}

/// A text from bytes; what is not UTF-8 is shown by its line and column.
pub(crate) fn decode(name: &str, bytes: Vec<u8>) -> Result<Source, Diagnostic> {
    String::from_utf8(bytes).map(|text| Source::new(name, text)).map_err(|error| {
        let valid = error.utf8_error().valid_up_to();
        let before = String::from_utf8_lossy(&error.as_bytes()[..valid]).into_owned();
        let (line, column) = Source::new(name, before).position(valid);
        Diagnostic::at(name, line, column, "expected UTF-8 text, found bytes that are none")
    })
}
