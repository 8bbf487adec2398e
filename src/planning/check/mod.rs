//! Whether the rest of a stored plan still reaches its goal.

mod fault;
mod report;

use bson::Bson;

use super::{PlanningError, PlanningTask};
use crate::formats::{Diagnostic, Source};
use crate::memory::Memory;
use crate::pddl::{Cause, Repair, Step, Validation, repair_rest, validate_rest};
use crate::plan::{Input, Record, Status, Stored, TaskSource, spelled};

pub use fault::{Fault, Origin};

/// What is left of a plan, and whether it still reaches the goal.
#[derive(Debug)]
pub struct Check {
    /// The plan's id.
    pub id: String,
    /// How many steps are left.
    pub left: usize,
    /// How many steps the plan has.
    pub steps: usize,
    /// Why the plan does not hold.
    pub fault: Option<Fault>,
    /// Why the plan could not be simulated.
    pub unjudged: Option<String>,
    /// Whether the problem was a file, which does not change with the memory: then every step was simulated, from
    /// the file's initial state.
    pub is_from_file: bool,
}

/// Instantiates the plan's problem as it is now, or takes `now` for it, and simulates the steps that are left. A step that
/// is running has begun: see [`validate_rest`].
///
/// # Errors
/// Where the plan does not say what it was made from, or is not a plan; where the problem is wrong, other than that
/// objects are gone; a store that fails.
pub fn check(record: &Record, now: Option<Source>, memory: &Memory) -> Result<Check, PlanningError> {
    let mut source = record.source().map_err(|error| PlanningError::NoSource { id: record.id(), error })?;
    let is_from_file = now.is_none() && !source.is_template();
    if let Some(problem) = now {
        source.input = Input::Problem(problem);
    }
    let progress = record.progress();
    let is_left = |status: Status| is_from_file || status != Status::Done;
    let steps = progress.iter().enumerate();
    let left: Vec<usize> = steps.filter(|(_, step)| is_left(step.status)).map(|(index, _)| index).collect();
    let failed = progress.iter().position(|step| step.status == Status::Failed);
    let verdict = match failed {
        Some(index) => Verdict::Broken(Fault::failed(index + 1)),
        None => simulate(record, &source, is_from_file, &left, memory)?,
    };
    let (fault, unjudged) = match verdict {
        Verdict::Holds => (None, None),
        Verdict::Broken(fault) => (Some(fault), None),
        Verdict::Unchecked(reason) => (None, Some(reason)),
    };
    Ok(Check { id: record.id(), left: left.len(), steps: progress.len(), fault, unjudged, is_from_file })
}

/// What a simulation shows.
enum Verdict {
    Holds,
    Broken(Fault),
    Unchecked(String),
}

fn simulate(
    record: &Record,
    source: &TaskSource,
    is_from_file: bool,
    left: &[usize],
    memory: &Memory,
) -> Result<Verdict, PlanningError> {
    let domain = &source.read_domain()?;
    let task = match PlanningTask::instantiate(source, None, domain, memory) {
        Ok(task) => task,
        // Objects of the goal or of facts that are gone.
        Err(PlanningError::Pddl { wrong, .. }) if wrong.0.iter().all(Diagnostic::is_missing) => {
            let message = format!("the problem cannot be instantiated any more:\n{wrong}");
            return Ok(Verdict::Broken(Fault { message, ..Fault::default() }));
        }
        Err(error) => return Err(error),
    };
    let names = task.names(domain);
    let name = |value: &Bson| names.get(value).or_else(|| spelled(value));
    let plan = match record.plan(&name).map_err(|error| PlanningError::NotAPlan { id: record.id(), error })? {
        Stored::Plan(plan) => plan,
        Stored::Failure(outcome) => {
            let message = format!("there is no plan: {}", outcome.as_deref().unwrap_or("none was found"));
            return Ok(Verdict::Broken(Fault { message, ..Fault::default() }));
        }
    };
    let steps = rest(&plan.steps, left);
    let progress = record.progress();
    let is_running = |index: usize| progress.get(index).is_some_and(|step| step.status == Status::Running);
    // A file shows the state before the first step.
    let running: Vec<usize> = match is_from_file {
        true => Vec::new(),
        false => left.iter().enumerate().filter(|(_, index)| is_running(**index)).map(|(place, _)| place).collect(),
    };
    Ok(match validate_rest(domain, &task.problem, &steps, &running) {
        Validation::Valid { .. } => Verdict::Holds,
        Validation::Unchecked(reason) => Verdict::Unchecked(reason),
        Validation::Invalid(failure) => {
            let mut repairs = repair_rest(domain, &task.problem, &steps, &running);
            repairs.iter_mut().for_each(|repair| recount(repair, left));
            Verdict::Broken(Fault { repairs, ..Fault::new(&failure, left, &steps, &task) })
        }
    })
}

/// The steps that are left; those with times begin at once.
fn rest(steps: &[Step], left: &[usize]) -> Vec<Step> {
    let mut rest: Vec<Step> = left.iter().filter_map(|index| steps.get(*index)).cloned().collect();
    if rest.len() < steps.len() {
        let first = rest.iter().filter_map(|step| step.start).fold(f64::INFINITY, f64::min);
        rest.iter_mut().for_each(|step| step.start = step.start.map(|start| start - first));
    }
    rest
}

/// Counts the step that undid a condition from the start of the whole plan.
fn recount(repair: &mut Repair, left: &[usize]) {
    if let Cause::Step { step, .. } = &mut repair.cause
        && let Some(place) = left.get(*step)
    {
        *step = *place;
    }
}
