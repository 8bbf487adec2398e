//! `rmem plan rerun ID`: a plan for the same task, from the memory as it is now.

use std::time::Duration;

use clap::Args;

use super::find::{choose, find};
use super::source::SectionCounts;
use super::stored::{self, StoredArgs};
use crate::commands::at::AtArgs;
use crate::commands::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::quantity;
use crate::plan::{Input, Last, Record};
use crate::planning::{PlanRequest, PlanningError, SearchOptions};
use crate::problem;

/// Plan again for the task of a stored plan, from the memory as it is now
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  rmem plan rerun last\n  rmem plan rerun last --timeout 5s")]
#[command(arg = formats::argument(&formats::PLAN))]
pub struct RerunArgs {
    /// The plan.
    #[command(flatten)]
    pub plan: StoredArgs,
    /// Planner to use instead of the plan's (can be repeated; the first valid plan wins)
    #[arg(long, value_name = "NAME")]
    pub planner: Vec<String>,
    /// Time limit instead of the plan's
    #[arg(long, value_name = "DURATION", value_parser = quantity::time_limit)]
    pub timeout: Option<Duration>,
    /// Memory limit instead of the plan's
    #[arg(long, value_name = "SIZE", value_parser = quantity::memory_limit)]
    pub memory_limit: Option<u64>,
    /// The memory as it was.
    #[command(flatten)]
    pub past: AtArgs,
    /// Do not store the plan
    #[arg(long)]
    pub no_store: bool,
}

pub(super) fn run(args: &RerunArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let record = stored::get(&args.plan, Last::Run, &memory, context)?;
    let source = record.source().map_err(|error| PlanningError::NoSource { id: record.id(), error })?;
    stored::warn_of_changes(&record.id(), &source, context);
    let options = options(args, &record);
    let names = if args.planner.is_empty() { SearchOptions::recorded_planners(&record) } else { args.planner.clone() };
    let planners = choose(&names, options.anytime, context)?;
    let mut request = PlanRequest::new(source, planners, options)?;
    request.rerun_of = Some(record.id());
    if let (Some(_), Input::Template(template)) = (args.past.at, &request.source.input) {
        request.generated = Some(problem::generate(template, &args.past.memory(context)?)?);
    }
    Ok(find(&request, SectionCounts::Printed, &memory, context)?.exit)
}

/// The options of the plan, but for those that are given anew.
fn options(args: &RerunArgs, record: &Record) -> SearchOptions {
    let recorded = SearchOptions::recorded(record);
    SearchOptions {
        timeout: args.timeout.unwrap_or(recorded.timeout),
        memory_limit: args.memory_limit.or(recorded.memory_limit),
        into: (!args.no_store).then(|| args.plan.namespace.clone()),
        ..recorded
    }
}
