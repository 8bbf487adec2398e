//! Conditions prepared to be solved as joins.

use std::ops::Range;

use super::stratum::free_slots;
use crate::pddl::model::{Arg, Fact, Formula, Quantifier};

/// A condition prepared to be solved.
pub(super) struct Goal {
    pub(super) kind: Kind,
    /// The variables from outside that it mentions.
    pub(super) free: Vec<u32>,
    /// The numbers of the facts in it.
    pub(super) facts: Range<usize>,
}

/// What is to hold.
pub(super) enum Kind {
    Fact(Fact),
    Same(Arg, Arg),
    All(Vec<Goal>),
    Any(Vec<Goal>),
    Exists(Quantifier, Box<Goal>),
    /// What is looked at when its variables have values.
    Test(Formula),
}

impl Goal {
    /// Prepares a condition with so many variables.
    pub(super) fn new(formula: &Formula, variables: usize) -> Self {
        Self::number(formula, u32::try_from(variables).unwrap_or(u32::MAX), &mut 0)
    }

    fn number(formula: &Formula, scope: u32, count: &mut usize) -> Self {
        let first = *count;
        let kind = match formula {
            Formula::Fact(fact) => {
                *count += 1;
                Kind::Fact(fact.clone())
            }
            Formula::Same(left, right) if *left != Arg::Fluent && *right != Arg::Fluent => Kind::Same(*left, *right),
            Formula::And(parts) => {
                let parts = parts.iter().map(|part| Self::number(part, scope, count));
                Kind::All(parts.flat_map(Self::parts).collect())
            }
            Formula::Or(parts) => Kind::Any(parts.iter().map(|part| Self::number(part, scope, count)).collect()),
            Formula::Exists(quantifier, inner) => {
                let end =
                    quantifier.first.saturating_add(u32::try_from(quantifier.variables.len()).unwrap_or(u32::MAX));
                Kind::Exists(quantifier.clone(), Box::new(Self::number(inner, end, count)))
            }
            other => Kind::Test(other.clone()),
        };
        let mut free = Vec::new();
        free_slots(formula, scope, &mut free);
        Self { kind, free, facts: first..*count }
    }

    /// The parts of a conjunction, or the goal itself.
    fn parts(self) -> Vec<Self> {
        match self.kind {
            Kind::All(parts) => parts,
            _ => vec![self],
        }
    }

    /// Calls `fact` with the facts to be joined and their numbers, and `test` with the conditions that are only looked at.
    pub(super) fn each_part(&self, fact: &mut dyn FnMut(usize, &Fact), test: &mut dyn FnMut(&Formula)) {
        match &self.kind {
            Kind::Fact(known) => fact(self.facts.start, known),
            Kind::Same(..) => {}
            Kind::All(parts) | Kind::Any(parts) => parts.iter().for_each(|part| part.each_part(fact, test)),
            Kind::Exists(_, inner) => inner.each_part(fact, test),
            Kind::Test(formula) => test(formula),
        }
    }
}
