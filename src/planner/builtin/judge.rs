//! Whether a plan holds by the rules of the validator, before it is given out.
//!
//! The engine and the searches compress time and relax numbers; where one of their plans does not hold, the plan before it
//! is still the best one.

use std::cell::OnceCell;

use ferroplan::Plan;

use super::ff_output;
use crate::formats::Source;
use crate::formats::pddl::Dialect;
use crate::formats::plan::ff;
use crate::pddl::{self, Domain, Problem, Step, Validation, validate};
use crate::planner::run::spaced;
use crate::planner::task::Task;

/// Judges the plans for a task.
pub(super) struct Judge<'t> {
    domain: &'t str,
    problem: &'t str,
    /// The task as the validator reads it, where it does.
    read: OnceCell<Option<(Domain, Problem)>>,
    /// Whether a plan was found to hold.
    pub(super) has_plan: bool,
    /// What was wrong with the last plan that did not hold.
    pub(super) fault: Option<String>,
}

impl<'t> Judge<'t> {
    /// For the texts of a task.
    pub(super) fn new(domain: &'t str, problem: &'t str) -> Self {
        Self { domain, problem, read: OnceCell::new(), has_plan: false, fault: None }
    }

    /// Whether a plan of this task holds, as it is printed; one that cannot be simulated is taken to hold.
    pub(super) fn allows(&mut self, plan: &Plan) -> bool {
        match self.wrong(plan) {
            None => self.has_plan = true,
            fault => {
                self.fault = fault;
                return false;
            }
        }
        true
    }

    /// Whether a plan was simulated, and holds.
    #[cfg(test)]
    pub(super) fn is_valid(&self, plan: &Plan) -> bool {
        let Some((domain, problem)) = self.read.get_or_init(|| self.read()) else { return false };
        matches!(validate(domain, problem, &steps(plan)), Validation::Valid { .. })
    }

    /// What is wrong with a plan.
    fn wrong(&self, plan: &Plan) -> Option<String> {
        let (domain, problem) = self.read.get_or_init(|| self.read()).as_ref()?;
        let steps = steps(plan);
        match validate(domain, problem, &steps) {
            Validation::Invalid(fault) => {
                let plan = pddl::Plan { steps, cost: None };
                spaced(&plan, &Task { domain, problem }).is_none().then(|| fault.to_string())
            }
            Validation::Valid { .. } | Validation::Unchecked(_) => None,
        }
    }

    fn read(&self) -> Option<(Domain, Problem)> {
        let domain = Domain::read(&Source::new("domain", self.domain), Dialect::default()).ok()?;
        let problem = Problem::read(&Source::new("problem", self.problem), &domain, Dialect::default()).ok()?;
        Some((domain, problem))
    }
}

/// The steps of a plan as it is printed, in order of time.
fn steps(plan: &Plan) -> Vec<Step> {
    let printed = ff::read(&ff_output::plan(plan, None), "");
    let mut steps: Vec<Step> = printed.actions.into_iter().map(Step::from).collect();
    steps.sort_by(|one, other| one.start.unwrap_or_default().total_cmp(&other.start.unwrap_or_default()));
    steps
}
