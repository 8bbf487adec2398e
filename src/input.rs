//! Input: texts from files and stdin, and the two kinds of errors in what a user gives.

use crate::fault::{AtFault, Fault};
use crate::formats::{Diagnostic, Source, plain};

/// A mistake in the command line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(String);

impl AtFault for UsageError {
    fn fault(&self) -> Fault {
        Fault::Usage
    }
}

impl UsageError {
    /// Returns an error whose text says what is wrong and what was expected.
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

/// A mistake in an input as a whole, at no single place.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct WrongInput(String);

impl AtFault for WrongInput {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

impl WrongInput {
    /// Returns an error whose text says what is wrong and what was expected.
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

/// Returns the error for an input that cannot be read.
pub(crate) fn unreadable(name: &str, error: &std::io::Error) -> WrongInput {
    WrongInput::new(format!("cannot read {name}: {}", plain::words(&error.to_string())))
}

/// Returns the text that bytes spell; an error has the line and column of the first that is not UTF-8.
pub(crate) fn decode(name: &str, bytes: Vec<u8>) -> Result<Source, Diagnostic> {
    String::from_utf8(bytes).map(|text| Source::new(name, text)).map_err(|error| {
        let valid = error.utf8_error().valid_up_to();
        let before = String::from_utf8_lossy(&error.as_bytes()[..valid]).into_owned();
        let (line, column) = Source::new(name, before).position(valid);
        Diagnostic::at(name, line, column, "expected UTF-8 text, found invalid UTF-8")
    })
}
