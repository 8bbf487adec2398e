//! `rmem plan rerun ID`: a plan for the same task, from the memory as it is now.

use super::search::{choose, find};
use super::source::SectionCounts;
use super::stored;
use crate::cli::PlanRerun;
use crate::commands::Context;
use crate::exit::Exit;
use crate::plan::Record;
use crate::planning::{PlanRequest, PlanningError, SearchOptions};

pub(super) fn run(args: &PlanRerun, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let memory = context.memory()?;
    let record = stored::get(&args.plan.id, &args.plan.namespace, &memory)?;
    let source = record.source().map_err(|error| PlanningError::NoSource { id: record.id(), error })?;
    let options = options(args, &record);
    let names = if args.planner.is_empty() { SearchOptions::recorded_planners(&record) } else { args.planner.clone() };
    let planners = choose(&names, options.anytime, context)?;
    let mut request = PlanRequest::new(source, planners, options)?;
    request.rerun_of = Some(record.id());
    Ok(find(&request, SectionCounts::Printed, &memory, context)?.exit)
}

/// The options of the plan, but for those that are given anew.
fn options(args: &PlanRerun, record: &Record) -> SearchOptions {
    let recorded = SearchOptions::recorded(record);
    SearchOptions {
        timeout: args.timeout.unwrap_or(recorded.timeout),
        memory_limit: args.memory_limit.or(recorded.memory_limit),
        into: (!args.no_store).then(|| args.plan.namespace.clone()),
        ..recorded
    }
}
