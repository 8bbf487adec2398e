//! Conditions and effects with every name resolved.
//!
//! Objects, predicates and functions are numbers of their tables. Variables are
//! slots: an action's parameters come first, and each quantifier takes the slots
//! after those around it.

use std::sync::Arc;

use super::types::TypeSet;
use crate::formats::pddl::ast::{Assigner, Comparator, Modal, Moment, Name, Operator};

/// A variable of an action, a rule or a quantifier.
#[derive(Debug, Clone)]
pub(super) struct Variable {
    /// With its `?`.
    pub(super) name: Name,
    pub(super) kind: TypeSet,
}

/// An argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Arg {
    Slot(u32),
    Object(u32),
    /// An object fluent, whose value is not simulated.
    Fluent,
}

/// A predicate applied to arguments.
#[derive(Debug, Clone)]
pub(super) struct Fact {
    pub(super) predicate: u32,
    pub(super) arguments: Box<[Arg]>,
}

/// A function applied to arguments.
#[derive(Debug, Clone)]
pub(super) struct Fluent {
    pub(super) function: u32,
    pub(super) arguments: Box<[Arg]>,
}

/// An arithmetical expression.
#[derive(Debug, Clone)]
pub(super) enum Number {
    Constant(f64),
    Fluent(Fluent),
    Operation(Operator, Vec<Number>),
    /// `?duration`
    Duration,
    /// `#t`
    Elapsed,
    /// `total-time`
    TotalTime,
    /// `(is-violated p)`
    Violations(Arc<str>),
}

/// A condition.
#[derive(Debug, Clone)]
pub(super) enum Formula {
    Fact(Fact),
    Same(Arg, Arg),
    Compare(Comparator, Number, Number),
    Not(Box<Formula>),
    And(Vec<Formula>),
    Or(Vec<Formula>),
    Imply(Box<Formula>, Box<Formula>),
    Forall(Quantifier, Box<Formula>),
    Exists(Quantifier, Box<Formula>),
    Timed(Moment, Box<Formula>),
    /// With its name, which its violations are counted under.
    Preference(Option<Arc<str>>, Box<Formula>),
    /// A trajectory operator, its numbers and its conditions.
    Modal(Modal, Vec<f64>, Vec<Formula>),
}

impl Formula {
    /// What holds always.
    pub(super) const fn truth() -> Self {
        Self::And(Vec::new())
    }
}

/// The variables of a `forall` or `exists`, and the slot of the first.
#[derive(Debug, Clone)]
pub(super) struct Quantifier {
    pub(super) first: u32,
    pub(super) variables: Vec<Variable>,
}

/// An effect.
#[derive(Debug, Clone)]
pub(super) enum Change {
    Add(Fact),
    Delete(Fact),
    And(Vec<Change>),
    Forall(Quantifier, Box<Change>),
    When(Box<Formula>, Box<Change>),
    Timed(Moment, Box<Change>),
    Assign(Assigner, Fluent, Number),
    /// An object fluent gets a value, which is not simulated.
    AssignObject,
}

/// What an action needs and does.
#[derive(Debug, Clone)]
pub(super) struct Body {
    /// [`None`] unless it is a durative action.
    pub(super) duration: Option<Formula>,
    pub(super) condition: Formula,
    pub(super) effect: Change,
}

/// A derived predicate's rule; its head's parameters are the first slots.
#[derive(Debug, Clone)]
pub(super) struct Rule {
    pub(super) predicate: u32,
    pub(super) variables: Vec<Variable>,
    pub(super) condition: Formula,
}
