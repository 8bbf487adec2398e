//! A task: what a planner is asked.

use crate::formats::Source;
use crate::pddl::{Domain, Feature, Problem, Use};

/// A domain and a problem to find a plan for.
#[derive(Debug, Clone, Copy)]
pub struct Task<'a> {
    /// The domain.
    pub domain: &'a Domain,
    /// The problem.
    pub problem: &'a Problem,
}

impl<'a> Task<'a> {
    /// The uses of features of PDDL, each with the text it is in: first the domain's, then the problem's.
    pub(super) fn uses(&self) -> impl Iterator<Item = (&'a Use, &'a Source)> + use<'a> {
        let (domain, problem) = (self.domain, self.problem);
        let uses = domain.features().iter().map(|used| (used, domain.source()));
        uses.chain(problem.features().iter().map(|used| (used, problem.source())))
    }

    /// The features that are used.
    pub(super) fn features(&self) -> impl Iterator<Item = Feature> + use<'a> {
        self.uses().map(|(used, _)| used.feature)
    }

    /// Whether the costs of actions are its only numbers.
    pub(super) fn has_only_costs(&self) -> bool {
        let is_other = |feature: Feature| {
            matches!(
                feature,
                Feature::NumericFluents | Feature::DurativeActions | Feature::ObjectFluents | Feature::Preferences
            )
        };
        !self.domain.tree().functions.is_empty() && !self.features().any(is_other)
    }
}
