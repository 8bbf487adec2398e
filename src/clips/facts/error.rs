//! Why a document is no fact.

use crate::fault::{AtFault, Fault};

/// Why a document is not a fact.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the key `{key}` {message}")]
pub struct FactError {
    key: String,
    message: String,
    /// What would help, if anything does.
    remedy: Option<Remedy>,
}

impl AtFault for FactError {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

impl FactError {
    pub(super) fn new(key: &str, message: impl Into<String>) -> Self {
        Self { key: key.escape_debug().to_string(), message: message.into(), remedy: None }
    }

    /// The same error with what would help.
    pub(super) fn remedy(self, remedy: Remedy) -> Self {
        Self { remedy: Some(remedy), ..self }
    }

    /// The key that cannot be represented.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.key
    }

    /// What would avoid the error; none where only another document would.
    #[must_use]
    pub fn hint(&self) -> Option<&'static str> {
        self.remedy.map(|remedy| match remedy {
            Remedy::Flatten => "--nested flatten makes slots of nested keys, --nested json writes a string",
            Remedy::Json => "--nested json writes a string",
            Remedy::Form => {
                "--as assert or --as deffacts NAME writes it as (sym-cat \"=\"); in a slot of type STRING it is a string"
            }
            Remedy::Query => "the query {relation: {$type: 'string'}} leaves out documents without a template",
        })
    }
}

/// What would avoid an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Remedy {
    /// Either way to treat nested values.
    Flatten,
    /// Writing the value as JSON.
    Json,
    /// Another form of the facts.
    Form,
    /// A query that leaves the document out.
    Query,
}
