//! What a simulation keeps beside the state: how often preferences were violated, and conditional effects that wait.

use std::collections::{HashMap, HashSet};

use crate::pddl::model::{Change, Formula, Number};

/// The violations so far.
#[derive(Debug, Default)]
pub(in crate::pddl) struct Violations {
    /// By name, in lower case.
    counts: HashMap<String, f64>,
    /// The preferences of conditions that were counted already: the step, and which of its preferences.
    pub(super) counted: HashSet<(Option<usize>, usize)>,
}

impl Violations {
    /// What `(is-violated NAME)` stands for.
    pub(super) fn count(&self, name: &str) -> f64 {
        self.counts.get(&name.to_lowercase()).copied().unwrap_or_default()
    }

    pub(super) fn add(&mut self, name: &str) {
        *self.counts.entry(name.to_lowercase()).or_default() += 1.0;
    }
}

/// Whether a metric counts violations.
pub(super) fn counts_violations(metric: &Number) -> bool {
    match metric {
        Number::Violations(_) => true,
        Number::Operation(_, operands) => operands.iter().any(counts_violations),
        _ => false,
    }
}

/// A conditional effect at the end of a running action whose condition is about other moments too.
pub(super) struct Pending {
    pub(super) condition: Formula,
    pub(super) effect: Change,
    pub(super) bindings: Vec<u32>,
    /// Whether what the condition says of the moments so far was true.
    pub(super) holds: bool,
}
