//! Stored plans on the command line: which one, and why it is not found.

use clap::Args;

use crate::commands::WrongInput;
use crate::error::Result;
use crate::memory::Memory;
use crate::plan::{PlanDocumentError, Record, Repository};
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
pub(super) fn get(id: &str, namespace: &Namespace, memory: &Memory) -> Result<Record> {
    Ok(Repository::new(memory, namespace).get(id)?)
}

/// A document that has a `plan` but is none.
pub(super) fn broken(id: &str, error: &PlanDocumentError) -> WrongInput {
    WrongInput::new(format!("{id} is no plan that rmem reads: {error}"))
}
