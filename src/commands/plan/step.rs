//! `rmem plan step ID N --done`: what became of a step.

use bson::DateTime;

use super::stored;
use crate::cli::{PlanState, PlanStep};
use crate::commands::{Context, UsageError};
use crate::exit::Exit;
use crate::plan::{Record, Repository, Status};

pub(super) fn run(args: &PlanStep, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let memory = context.memory()?;
    let archive = Repository::new(&memory, &args.namespace);
    let plan = archive.get(&args.id).map_err(stored::explain)?;
    let number = number(&args.step, &plan)?;
    archive.mark(&plan, number, status(args.state), DateTime::now()).map_err(stored::explain)?;
    context.output.note(&format!("step {number} of {} is {}", plan.id(), status(args.state)));
    Ok(Exit::Done)
}

fn status(state: PlanState) -> Status {
    match state {
        PlanState { done: true, .. } => Status::Done,
        PlanState { failed: true, .. } => Status::Failed,
        PlanState { started: true, .. } => Status::Running,
        _ => Status::Open,
    }
}

fn number(text: &str, plan: &Record) -> Result<usize, UsageError> {
    if text == "next" {
        let next = plan.progress().iter().position(|step| step.status != Status::Done);
        return next.map(|index| index + 1).ok_or_else(|| UsageError::new(format!("{} has no step left", plan.id())));
    }
    text.parse().map_err(|_| UsageError::new(format!("`{text}` is no step; expected a number from 1, or `next`")))
}
