//! The execution of a pipeline: its time, its variables, and the other collections.

use std::rc::Rc;

use bson::DateTime;

use super::documents::{Documents, Origin, Sources};
use crate::query::expression::{Environment, Variables};
use crate::query::view::Fields;

/// The state that all stages of a run share.
pub(super) struct Run<'a, E> {
    pub(super) now: DateTime,
    pub(super) variables: Rc<Variables>,
    sources: &'a Sources<'a, E>,
}

impl<E> Clone for Run<'_, E> {
    fn clone(&self) -> Self {
        Self { now: self.now, variables: Rc::clone(&self.variables), sources: self.sources }
    }
}

impl<'a, E> Run<'a, E> {
    pub(super) fn new(now: DateTime, variables: Variables, sources: &'a Sources<'a, E>) -> Self {
        Self { now, variables: Rc::new(variables), sources }
    }

    /// Returns the same run with other variables.
    pub(super) fn with(&self, variables: Variables) -> Self {
        Self { now: self.now, variables: Rc::new(variables), sources: self.sources }
    }

    pub(super) fn source(&self, origin: &Origin) -> Result<Documents<'a, E>, E> {
        (self.sources)(origin)
    }

    pub(super) fn environment<'b>(&'b self, fields: Fields<'b>) -> Environment<'b> {
        Environment::new(fields, &self.variables, self.now)
    }
}
