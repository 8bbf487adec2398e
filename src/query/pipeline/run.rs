//! The execution of a pipeline: its time, its variables, and the other collections.

use std::rc::Rc;

use bson::{DateTime, Document};

use super::documents::{Documents, Origin, Sources};
use crate::query::expression::{Environment, Variables};
use crate::query::spill::Spill;
use crate::query::view::Fields;

/// The state that all stages of a run share.
pub(super) struct Run<'a, E> {
    pub(super) now: DateTime,
    pub(super) variables: Rc<Variables>,
    /// Whether documents carry their score, which stays when they are changed.
    pub(super) is_scored: bool,
    sources: &'a Sources<'a, E>,
    spill: Rc<Spill>,
}

impl<E> Clone for Run<'_, E> {
    fn clone(&self) -> Self {
        Self { variables: Rc::clone(&self.variables), spill: Rc::clone(&self.spill), ..*self }
    }
}

impl<'a, E> Run<'a, E> {
    pub(super) fn new(now: DateTime, variables: Variables, sources: &'a Sources<'a, E>, spill: Spill) -> Self {
        Self { now, variables: Rc::new(variables), is_scored: false, sources, spill: Rc::new(spill) }
    }

    /// Returns the same run with other variables.
    pub(super) fn with(&self, variables: Variables) -> Self {
        Self { variables: Rc::new(variables), spill: Rc::clone(&self.spill), ..*self }
    }

    pub(super) fn source(&self, origin: &Origin) -> Result<Documents<'a, E>, E> {
        Ok((self.sources)(origin, None)?.unwrap_or_else(|| Box::new(std::iter::empty())))
    }

    /// The documents of another collection that match; nothing where no index finds them.
    pub(super) fn indexed(&self, origin: &Origin, filter: &Document) -> Result<Option<Documents<'a, E>>, E> {
        (self.sources)(origin, Some(filter))
    }

    /// How much memory a stage may hold.
    pub(super) fn spill(&self) -> &Spill {
        &self.spill
    }

    pub(super) fn environment<'b>(&'b self, fields: Fields<'b>) -> Environment<'b> {
        Environment::new(fields, &self.variables, self.now)
    }
}
