//! What PDDL means: domains, problems, checks, and the simulation of plans.
//!
//! How it is spelled is [`crate::formats::pddl`]'s business.

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
