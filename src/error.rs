//! An error of any type with what is at fault and what was being done: how commands fail.
//!
//! [`anyhow::Error`] takes an error of any type, too, and forgets what the type says beyond its text. This one takes what is
//! [`AtFault`] only: an error type that does not say whose fault it is cannot leave a command.

use std::fmt;

use crate::fault::{AtFault, Fault};

/// The result of what a command does.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An error of any type, what was being done, and what is at fault.
pub struct Error {
    fault: Fault,
    inner: anyhow::Error,
}

impl Error {
    /// Returns what is at fault.
    #[must_use]
    pub fn fault(&self) -> Fault {
        self.fault
    }

    /// Returns the same error, with what was being done before it.
    #[must_use]
    pub fn context(self, doing: impl fmt::Display + Send + Sync + 'static) -> Self {
        Self { inner: self.inner.context(doing), ..self }
    }

    /// Returns the texts and errors, outermost first.
    pub fn chain(&self) -> impl Iterator<Item = &(dyn std::error::Error + 'static)> {
        self.inner.chain()
    }

    /// Returns the error, where it is of this type.
    #[must_use]
    pub fn downcast_ref<E: AtFault + fmt::Display>(&self) -> Option<&E> {
        self.inner.downcast_ref()
    }

    /// Returns the error itself, where it is of this type.
    ///
    /// # Errors
    /// The error as it was, where it is of another type.
    pub fn downcast<E: AtFault + fmt::Display>(self) -> Result<E> {
        let fault = self.fault;
        self.inner.downcast().map_err(|inner| Self { fault, inner })
    }
}

impl<E: AtFault> From<E> for Error {
    fn from(error: E) -> Self {
        Self { fault: error.fault(), inner: error.into() }
    }
}

/// Shows the outermost text; `{:#}` shows all of them.
impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.inner.fmt(f)
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.inner.fmt(f)
    }
}

/// Adds to an error what was being done.
pub trait Context<T> {
    /// Puts a text before the error.
    ///
    /// # Errors
    /// The error with the text, where there is one.
    fn context(self, doing: impl fmt::Display + Send + Sync + 'static) -> Result<T>;

    /// Puts a text before the error, which is made only where there is one.
    ///
    /// # Errors
    /// As [`Context::context`].
    fn with_context<D: fmt::Display + Send + Sync + 'static>(self, doing: impl FnOnce() -> D) -> Result<T>;
}

impl<T, E: Into<Error>> Context<T> for Result<T, E> {
    fn context(self, doing: impl fmt::Display + Send + Sync + 'static) -> Result<T> {
        self.with_context(|| doing)
    }

    fn with_context<D: fmt::Display + Send + Sync + 'static>(self, doing: impl FnOnce() -> D) -> Result<T> {
        self.map_err(|error| error.into().context(doing()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn context_hides_neither_the_fault_nor_the_type() {
        let failed: std::result::Result<(), _> = Err(std::io::Error::other("disk full"));
        let error = failed.context("writing the plan").context("ending").unwrap_err();
        assert_eq!(error.fault(), Fault::Store);
        assert_eq!(format!("{error:#}"), "ending: writing the plan: disk full");
        assert!(error.downcast_ref::<std::io::Error>().is_some());
        assert!(error.downcast::<std::io::Error>().is_ok());
    }
}
