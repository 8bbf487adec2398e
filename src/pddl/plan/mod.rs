//! Plans: sequences of ground actions, with or without times.

mod spacing;
mod spelling;

use super::domain::Domain;
use super::problem::Problem;
use crate::formats::plan::{Action, PlanFile};

/// One ground action of a plan, as a planner or a file named it.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// The action's name; PDDL names are compared without regard to case.
    pub action: String,
    /// The arguments, in the order of the action's parameters.
    pub arguments: Vec<String>,
    /// When it starts, in the plan's time unit, for temporal plans.
    pub start: Option<f64>,
    /// How long it takes, for durative actions.
    pub duration: Option<f64>,
}

impl From<Action> for Step {
    fn from(action: Action) -> Self {
        Self { action: action.name, arguments: action.arguments, start: action.start, duration: action.duration }
    }
}

/// A sequence of ground actions that reaches a goal, with the names of the problem.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// The actions; sequential plans in order, temporal plans by start time.
    pub steps: Vec<Step>,
    /// Its cost, as the planner or the validator computed it.
    pub cost: Option<f64>,
}

impl Plan {
    /// Whether its actions have times.
    #[must_use]
    pub fn is_temporal(&self) -> bool {
        self.steps.iter().any(|step| step.start.is_some())
    }
}

impl Plan {
    /// The same plan without what planners print of time and the task does not have: durations of actions that take none, and
    /// all times where time is no part of the task; then the steps are in order.
    #[must_use]
    pub fn timed_as(mut self, domain: &Domain, problem: &Problem) -> Self {
        let start = |step: &Step| step.start.unwrap_or_default();
        if !problem.is_timed(domain) && self.makespan().is_some() {
            self.steps.sort_by(|a, b| start(a).total_cmp(&start(b)));
            self.steps.iter_mut().for_each(|step| (step.start, step.duration) = (None, None));
            return self;
        }
        for step in &mut self.steps {
            if domain.action(&step.action).is_some_and(|action| !action.is_durative()) {
                step.duration = step.duration.map(|_| 0.0);
            }
        }
        self
    }

    /// Returns when the last action ends, for a plan with times.
    #[must_use]
    pub fn makespan(&self) -> Option<f64> {
        let ends = self.steps.iter().filter_map(|step| Some(step.start? + step.duration.unwrap_or_default()));
        ends.reduce(f64::max)
    }
}

impl From<PlanFile> for Plan {
    fn from(file: PlanFile) -> Self {
        Self { steps: file.actions.into_iter().map(Step::from).collect(), cost: file.cost }
    }
}
