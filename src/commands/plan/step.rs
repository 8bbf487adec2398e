//! `rmem plan step ID N --done`: what became of a step.

use bson::DateTime;
use clap::Args;

use crate::commands::{Context, UsageError};
use crate::error::Result;
use crate::exit::Exit;
use crate::plan::{Record, Repository, Status};
use crate::store::Namespace;

/// Record how the execution of a step went
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  rmem plan step last 1 --started\n  rmem plan step last 1 --done\n\n\
Steps count from 1; `next` is the first that is not done. In the plan's document, the step gets\n\
the keys _status (running, done, failed), _started and _ended (dates).")]
pub struct StepArgs {
    /// The plan: its id, a unique prefix of it, or last
    #[arg(value_name = "ID")]
    pub id: String,
    /// The step, from 1; next is the first that is not done
    #[arg(value_name = "N")]
    pub step: String,
    /// What became of it.
    #[command(flatten)]
    pub state: StateArgs,
    /// Allow --done although an earlier step is open or has failed
    #[arg(long, requires = "done")]
    pub out_of_order: bool,
    /// Collection of the plans
    #[arg(long = "in", value_name = "NS", default_value = "robmem.plans")]
    pub namespace: Namespace,
}

/// What became of a step.
#[derive(Debug, Clone, Copy, Args)]
#[group(required = true, multiple = false)]
pub struct StateArgs {
    /// Mark it as begun
    #[arg(long)]
    pub started: bool,
    /// Mark it as done
    #[arg(long)]
    pub done: bool,
    /// Mark it as failed
    #[arg(long)]
    pub failed: bool,
    /// Mark it as not begun
    #[arg(long)]
    pub open: bool,
}

pub(super) fn run(args: &StepArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let repository = Repository::new(&memory, &args.namespace);
    let plan = repository.get(&args.id)?;
    let number = number(&args.step, &plan)?;
    check_order(number, args, &plan)?;
    repository.mark(&plan, number, status(args.state), DateTime::now())?;
    context.output.note(&format!("step {number} of {} is {}", plan.id(), status(args.state)));
    Ok(Exit::Done)
}

/// Refuses a step that would be done before an earlier one.
fn check_order(number: usize, args: &StepArgs, plan: &Record) -> Result<(), UsageError> {
    let progress = plan.progress();
    let is_waiting = |status: Status| matches!(status, Status::Open | Status::Failed);
    let earlier = progress.iter().take(number.saturating_sub(1)).position(|step| is_waiting(step.status));
    match earlier {
        Some(index) if args.state.done && !args.out_of_order => {
            let (step, status) = (index + 1, progress.get(index).map(|step| step.status).unwrap_or_default());
            Err(UsageError::new(format!(
                "step {number} cannot be done while step {step} is {status}; mark step {step} first, or give --out-of-order"
            )))
        }
        _ => Ok(()),
    }
}

fn status(state: StateArgs) -> Status {
    match state {
        StateArgs { done: true, .. } => Status::Done,
        StateArgs { failed: true, .. } => Status::Failed,
        StateArgs { started: true, .. } => Status::Running,
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
