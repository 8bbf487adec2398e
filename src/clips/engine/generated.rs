//! The problem that a program generated last.

use std::cell::RefCell;

use crate::memory::Memory;
use crate::problem::{self, Generated, ProblemError, Request};

/// The problem that was generated last, whose names are known.
#[derive(Default)]
pub(super) struct Planning {
    pub(super) last: RefCell<Option<(Request, Generated)>>,
}

impl Planning {
    /// Generates a problem; returns its text, and what is worth a note.
    pub(super) fn generate(&self, request: Request, memory: &Memory) -> Result<(String, Vec<String>), ProblemError> {
        let generated = problem::generate(&request, memory)?;
        let remarks = generated.remarks.iter().map(ToString::to_string);
        let (text, notes) = (generated.text.clone(), generated.respelled.iter().cloned().chain(remarks).collect());
        *self.last.borrow_mut() = Some((request, generated));
        Ok((text, notes))
    }
}
