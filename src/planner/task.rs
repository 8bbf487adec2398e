//! A task: what a planner is asked.

use crate::pddl::{Domain, Problem};

/// A domain and a problem to find a plan for.
#[derive(Debug, Clone, Copy)]
pub struct Task<'a> {
    /// The domain.
    pub domain: &'a Domain,
    /// The problem.
    pub problem: &'a Problem,
}
