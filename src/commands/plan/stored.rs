//! Stored plans on the command line: which one, and why it is not found.

use clap::Args;

use crate::commands::{UsageError, WrongInput};
use crate::memory::Memory;
use crate::plan::{PlanDocumentError, Record, Repository, RepositoryError};
use crate::store::Namespace;

/// Which stored plan.
#[derive(Debug, Clone, Args)]
pub struct StoredArgs {
    /// The plan: its id, a unique prefix of it, or last
    #[arg(value_name = "ID")]
    pub id: String,
    /// Collection of the plans
    #[arg(long = "in", value_name = "NS", default_value = "robmem.plans")]
    pub namespace: Namespace,
}

/// The plan with an id.
pub(super) fn get(id: &str, namespace: &Namespace, memory: &Memory) -> anyhow::Result<Record> {
    Repository::new(memory, namespace).get(id).map_err(explain)
}

/// An id that names no plan is a mistake of the command line.
pub(super) fn explain(error: RepositoryError) -> anyhow::Error {
    match error {
        RepositoryError::Store(error) => error.into(),
        error => UsageError::new(error.to_string()).into(),
    }
}

/// A document that has a `plan` but is none.
pub(super) fn broken(id: &str, error: &PlanDocumentError) -> WrongInput {
    WrongInput::new(format!("{id} is no plan that rmem reads: {error}"))
}
