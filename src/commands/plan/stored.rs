//! What the commands about stored plans share: finding one, and what is wrong with one.

use crate::commands::{UsageError, WrongInput};
use crate::memory::Memory;
use crate::plan::{Archive, ArchiveError, PlanDocumentError, Record};
use crate::store::Namespace;

/// The plan with an id.
pub(super) fn get(id: &str, namespace: &Namespace, memory: &Memory) -> anyhow::Result<Record> {
    Archive::new(memory, namespace).get(id).map_err(explain)
}

/// An id that names no plan is a mistake of the command line.
pub(super) fn explain(error: ArchiveError) -> anyhow::Error {
    match error {
        ArchiveError::Store(error) => error.into(),
        error => UsageError::new(error.to_string()).into(),
    }
}

/// A document that has a `plan` but is none.
pub(super) fn broken(id: &str, error: &PlanDocumentError) -> WrongInput {
    WrongInput::new(format!("{id} is no plan that rmem reads: {error}"))
}
