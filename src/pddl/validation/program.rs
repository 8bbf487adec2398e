//! The rules of derived predicates, prepared to be applied.

use super::error::EvaluationError;
use super::goal::Goal;
use super::stratum::{predicates, size, strata};
use crate::pddl::domain::Domain;
use crate::pddl::model::{Formula, Rule};
use crate::pddl::types::TypeSet;

/// How many nodes a rule's body may have to be solved as a join, whose recursion is as deep.
const JOIN_LIMIT: usize = 200;

/// The rules of a domain, prepared to be applied.
pub(super) type Program = Vec<Vec<Prepared>>;

/// A rule as it is applied.
pub(super) struct Prepared {
    pub(super) predicate: u32,
    pub(super) kinds: Vec<TypeSet>,
    pub(super) body: Body,
    /// The facts of its body that other rules of its stratum make, by their numbers there.
    pub(super) pivots: Vec<(usize, u32)>,
    /// The predicates that rules of its stratum make and its body looks at in other ways.
    pub(super) tested: Vec<u32>,
}

/// The condition of a rule.
pub(super) enum Body {
    Join(Goal),
    /// Too large for that.
    Test(Formula),
}

impl Prepared {
    fn new(rule: &Rule, stratum: &[u32]) -> Self {
        let kinds: Vec<TypeSet> = rule.variables.iter().map(|variable| variable.kind.clone()).collect();
        let (mut pivots, mut tested) = (Vec::new(), Vec::new());
        let mut test = |formula: &Formula| {
            predicates(formula, &mut |predicate, _| {
                if stratum.contains(&predicate) && !tested.contains(&predicate) {
                    tested.push(predicate);
                }
            });
        };
        let body = if size(&rule.condition) > JOIN_LIMIT {
            test(&rule.condition);
            Body::Test(rule.condition.clone())
        } else {
            let goal = Goal::new(&rule.condition, kinds.len());
            let mut fact = |number, predicate| {
                if stratum.contains(&predicate) {
                    pivots.push((number, predicate));
                }
            };
            goal.each_part(&mut |number, known| fact(number, known.predicate), &mut test);
            Body::Join(goal)
        };
        Self { predicate: rule.predicate, kinds, body, pivots, tested }
    }
}

/// Prepares the rules of a domain, in the order in which they can be completed.
pub(super) fn prepare(domain: &Domain) -> Result<Program, EvaluationError> {
    let strata = strata(&domain.rules)?;
    let prepared = strata.into_iter().map(|rules| {
        let stratum: Vec<u32> = rules.iter().map(|rule| rule.predicate).collect();
        rules.into_iter().map(|rule| Prepared::new(rule, &stratum)).collect()
    });
    Ok(prepared.collect())
}
