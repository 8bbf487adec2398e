//! What PDDL means: domains, problems, checks, and the simulation of plans.
//!
//! How it is spelled is [`crate::formats::pddl`]'s business. A [`Domain`] is read and
//! checked by itself, a [`Problem`] against its domain; what passes has every name
//! resolved. [`validate`] simulates a plan, and [`repair`] says what would mend one that breaks; [`why`] says what keeps a goal from ever being reached. Names compare without regard to case and
//! keep the spelling they were declared with.

mod axiom;
mod domain;
mod feature;
mod model;
mod problem;
mod reachability;
mod report;
mod resolve;
mod table;
mod types;
mod validation;
mod vocabulary;

pub use domain::{Action, Domain, Parameter, Predicate};
pub use feature::{Feature, Use};
pub use problem::{Object, Problem};
pub use reachability::{Achiever, Obstacle, Why, why};
pub use validation::{Cause, Failure, Remedy, Repair, Validation, repair, validate};

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

impl From<crate::formats::plan::Action> for Step {
    fn from(action: crate::formats::plan::Action) -> Self {
        Self { action: action.name, arguments: action.arguments, start: action.start, duration: action.duration }
    }
}
