//! A classical task, by the search of rmem's own.

use ferroplan::types::{Domain, Problem};
use ferroplan::{Plan, SolveError, Step};
use rustix::process::{Resource, getrlimit};

use super::convert::convert;
use super::Options;
use super::ff_output::NoPlan;
use super::search::lifted::Lifted;
use super::search::task::{OperatorId, Task};
use super::search::{End, Event, Ground, Improvement, Refusal, Settings, ground, solve};

/// The bytes for states where this process has no limit.
const MEMORY: usize = 4 << 30;

/// What becomes of a task.
pub(super) enum Answer {
    /// Its plans were said.
    Solved,
    /// It has none, or none was found.
    None(NoPlan),
    /// It is not for this search.
    Declined,
}

/// Finds a plan, and better and better ones where they are wanted.
///
/// # Errors
///
/// For axioms that have no order.
pub(super) fn plan(
    domain: &Domain,
    problem: &Problem,
    options: Options,
    found: &mut dyn FnMut(&Plan),
) -> Result<Answer, SolveError> {
    match convert(domain, problem) {
        Ok(lifted) => search(&lifted, memory(), options, found),
        Err(_) => Ok(Answer::Declined),
    }
}

fn search(
    lifted: &Lifted,
    memory: usize,
    options: Options,
    found: &mut dyn FnMut(&Plan),
) -> Result<Answer, SolveError> {
    let task = match ground(lifted, memory) {
        Ok(Ground::Task(task)) => task,
        Ok(Ground::GoalFalse) => return Ok(Answer::None(NoPlan::GoalFalse)),
        Err(Refusal::Wide) => return Ok(Answer::Declined),
        Err(Refusal::Circular) => {
            return Err(SolveError::Derived("a derived predicate depends on its own negation".to_owned()));
        }
        Err(Refusal::Explosion { action, instances }) => {
            return Ok(Answer::None(NoPlan::Full(format!("the action {action} has more than {instances} instances"))));
        }
    };
    let mut states = 0;
    let improvement = match options {
        Options { anytime: true, .. } => Improvement::Unbounded,
        Options { optimize: true, .. } if task.has_costs => Improvement::Bounded,
        _ => Improvement::Brief,
    };
    let mut best = None;
    let end = solve(&task, Settings { improvement, memory }, &mut |event| match event {
        Event::Plan(plan) if improvement == Improvement::Unbounded => found(&report(&task, plan)),
        Event::Plan(plan) => best = Some(report(&task, plan)),
        Event::States(count) => states = count,
    });
    if let Some(plan) = best {
        found(&plan);
    }
    Ok(match end {
        End::Solved => Answer::Solved,
        End::Unsolvable => Answer::None(NoPlan::Exhausted),
        End::Full => Answer::None(NoPlan::Full(format!("it had found more than {states} states"))),
    })
}

/// The bytes that states may take: about half of what this process may have, as lists that grow are copied.
fn memory() -> usize {
    let limit = getrlimit(Resource::As).current.and_then(|bytes| usize::try_from(bytes).ok());
    limit.map_or(MEMORY, |bytes| (bytes / 2).min(MEMORY))
}

/// A plan of operators as one of actions.
fn report(task: &Task, plan: &[OperatorId]) -> Plan {
    let step = |(index, operator): (usize, &OperatorId)| {
        let mut words = task.name(*operator).map(str::to_owned);
        Step { index, action: words.next().unwrap_or_default(), args: words.collect(), time: None, duration: None }
    };
    let steps = plan.iter().enumerate().map(step).collect();
    Plan { length: plan.len(), steps, metric: task.has_costs.then(|| task.cost(plan)), makespan: None }
}
