//! `rmem plan rerun ID`: a plan for the same task, from the memory as it is now.

use std::time::Duration;

use super::pose::{self, Sections};
use super::run::{PlanRequest, find};
use super::stored;
use crate::cli::{Layout, PlanEffort, PlanRerun};
use crate::commands::{Context, WrongInput};
use crate::exit::Exit;
use crate::plan::Record;

/// Where a plan does not say how long its planner was given.
const TIMEOUT: Duration = Duration::from_secs(60);

pub(super) fn run(args: &PlanRerun, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let memory = context.memory()?;
    let record = stored::get(&args.plan.id, &args.plan.namespace, &memory)?;
    let recipe = record.recipe().map_err(|error| WrongInput::new(format!("{}: {error}", record.id())))?;
    let domain = pose::domain(&recipe)?;
    let effort = effort(args, &record);
    let order = PlanRequest { recipe, domain, sections: Sections::Told, effort: &effort, rerun_of: Some(record.id()) };
    Ok(find(&order, &memory, context)?.exit)
}

/// The effort of the plan, but for what is said anew.
fn effort(args: &PlanRerun, record: &Record) -> PlanEffort {
    let lineage = record.lineage();
    let asked = lineage.and_then(|lineage| lineage.get_array("planners").ok()).into_iter().flatten();
    let asked: Vec<String> = asked.filter_map(|name| name.as_str().map(str::to_owned)).collect();
    let known = if asked.is_empty() { vec!["builtin".to_owned()] } else { asked };
    let timeout = lineage.and_then(|lineage| lineage.get_f64("timeout").ok());
    let limit = lineage.and_then(|lineage| lineage.get_i64("memory_limit").ok());
    let listed = record.document.contains_key("actions") || record.document.get_i32("plan").is_ok();
    PlanEffort {
        planner: if args.planner.is_empty() { known } else { args.planner.clone() },
        anytime: lineage.is_some_and(|lineage| lineage.get_bool("anytime").unwrap_or_default()),
        timeout: args
            .timeout
            .or(timeout.and_then(|millis| Duration::try_from_secs_f64(millis / 1000.0).ok()))
            .unwrap_or(TIMEOUT),
        memory_limit: args.memory_limit.or(limit.and_then(|limit| u64::try_from(limit).ok())),
        into: args.plan.namespace.clone(),
        layout: if listed { Layout::Fawkes } else { Layout::Numbered },
        no_store: args.no_store,
    }
}
