//! The lineage of a plan: what it was made from, and what the planners did.

use super::{PlanRequest, PlanningTask};
use crate::plan::{Lineage, Racer, TaskSource};
use crate::planner::{Race, Run};

impl PlanningTask {
    /// Returns the lineage of a plan for this problem, before it is searched for.
    #[must_use]
    pub fn lineage(&self, source: TaskSource) -> Lineage {
        Lineage {
            started: Some(self.started),
            times: vec![("instantiate".to_owned(), self.time)],
            ..Lineage::of(source, &self.problem, self.generated.as_ref())
        }
    }
}

/// The lineage of what a search gave, from that of its task ([`PlanningTask::lineage`]).
pub(super) fn lineage(mut lineage: Lineage, request: &PlanRequest, race: &Race, run: &Run) -> Lineage {
    lineage.planner.clone_from(&run.planner);
    lineage.version.clone_from(&run.version);
    lineage.arguments.clone_from(&run.command);
    run.outcome.word().clone_into(&mut lineage.outcome);
    lineage.cost = run.outcome.plan().and_then(|plan| plan.cost);
    lineage.length = run.outcome.plan().map(|plan| plan.steps.len());
    lineage.is_spaced = run.is_spaced;
    lineage.why.clone_from(&run.why);
    lineage.times.push(("plan".to_owned(), run.time));
    if race.runs.len() > 1 {
        lineage.race = race.runs.iter().map(|run| racer(race, run)).collect();
    }
    lineage.planners = request.planners.iter().map(|planner| planner.name().to_owned()).collect();
    lineage.anytime = request.options.anytime;
    lineage.timeout = Some(request.options.timeout);
    lineage.memory_limit = request.options.memory_limit;
    lineage.rerun_of.clone_from(&request.rerun_of);
    lineage
}

fn racer(race: &Race, run: &Run) -> Racer {
    Racer {
        planner: run.planner.clone(),
        version: run.version.clone(),
        outcome: race.word(run).to_owned(),
        time: run.time,
        cpu: run.cpu,
        length: run.outcome.plan().map(|plan| plan.steps.len()),
        message: run.message.clone(),
    }
}
