//! Why a function has no value.

use crate::clips::engine::native::CallError;
use crate::error::Error;
use crate::formats::plain;

/// Why a function has no value.
pub(super) enum Failure {
    /// The program is wrong; the evaluation ends.
    CallError(CallError),
    /// It was not possible; the function gives FALSE.
    Declined(String),
}

impl From<CallError> for Failure {
    fn from(error: CallError) -> Self {
        Self::CallError(error)
    }
}

impl Failure {
    /// It was not possible.
    pub(super) fn declined(error: impl std::fmt::Display) -> Self {
        Self::Declined(plain::words(&error.to_string()).into_owned())
    }

    /// It was not possible, for reasons that have reasons.
    pub(super) fn chained(error: &Error) -> Self {
        Self::Declined(plain::words(&format!("{error:#}")).into_owned())
    }

    /// The program is wrong.
    pub(super) fn wrong(message: impl Into<String>) -> Self {
        Self::CallError(CallError::Failed(message.into()))
    }
}
