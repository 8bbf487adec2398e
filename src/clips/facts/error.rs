//! Why a document is no fact.

use crate::fault::{AtFault, Fault};

/// Why a document is no fact.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the key `{key}` {message}")]
pub struct FactError {
    key: String,
    message: String,
    /// Whether `--nested` would help.
    nested: bool,
}

impl AtFault for FactError {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

impl FactError {
    pub(super) fn new(key: &str, message: impl Into<String>) -> Self {
        Self { key: key.escape_debug().to_string(), message: message.into(), nested: false }
    }

    /// The same error, which another [`super::Nested`] would avoid.
    pub(super) fn nested(self) -> Self {
        Self { nested: true, ..self }
    }

    /// The key that cannot be represented.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Whether another [`super::Nested`] would avoid it.
    #[must_use]
    pub fn is_nested(&self) -> bool {
        self.nested
    }
}
