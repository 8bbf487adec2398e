//! Stored plans on the command line: which one, and why it is not found.

use clap::Args;

use crate::commands::{Context, WrongInput};
use crate::error::Result;
use crate::memory::Memory;
use crate::plan::{LAST, Last, PlanDocumentError, Record, Repository};
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

/// The plan with an id; `last` is the kind of run that is wanted.
pub(super) fn get(plan: &StoredArgs, last: Last, memory: &Memory, context: &mut Context<'_>) -> Result<Record> {
    let repository = Repository::new(memory, &plan.namespace);
    if plan.id != LAST {
        return Ok(repository.get(&plan.id)?);
    }
    let found = repository.last(last)?;
    let newest = repository.last(Last::Run)?;
    if newest.id() != found.id() {
        let (newest, outcome) = (newest.id(), newest.outcome());
        let what = if outcome == "success" { "has no steps".to_owned() } else { format!("found no plan ({outcome})") };
        context.output.note(&format!("last is {}; the run {newest} after it {what}", found.id()));
    }
    Ok(found)
}

/// A document that has a `plan` but is none.
pub(super) fn broken(id: &str, error: &PlanDocumentError) -> WrongInput {
    WrongInput::new(format!("{id} is no plan that rmem reads: {error}"))
}
