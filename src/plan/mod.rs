//! Plans and the documents they are stored as.

use crate::pddl::Step;

/// A sequence of ground actions that reaches a goal.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// The actions; sequential plans in order, temporal plans by start time.
    pub steps: Vec<Step>,
    /// The planner's word on what it costs.
    pub cost: Option<f64>,
}
