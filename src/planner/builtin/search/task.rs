//! The task that is searched: variables with finite domains, operators with conditional effects, and axioms
//! (Helmert 2009; Bäckström and Nebel 1995 for the representation).
//!
//! A fact is a variable with one of its values; the facts of all variables are numbered one after another.

pub use super::number::Fact;
use super::number::{Numbers, NumericEffect};

/// The number of an operator.
pub type OperatorId = u32;

/// A condition, and the fact that it leads to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Effect {
    /// What must hold before; usually nothing but the operator's own condition.
    pub condition: Vec<Fact>,
    /// What holds afterwards.
    pub fact: Fact,
}

/// A ground action.
#[derive(Debug, Clone, PartialEq)]
pub struct Operator {
    /// The name and the arguments, by the numbers of [`Task::words`].
    pub name: Vec<u32>,
    /// When it is applicable: at most one fact of each variable, in order.
    pub condition: Vec<Fact>,
    /// What it changes. Of two effects on one variable whose conditions hold, the later one counts.
    pub effects: Vec<Effect>,
    /// The numbers it changes, in order.
    pub amounts: Vec<NumericEffect>,
    /// What it costs.
    pub cost: f64,
}

/// A rule for the value of a derived variable, which is its first value where no rule applies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Axiom {
    /// From what.
    pub condition: Vec<Fact>,
    /// What is derived.
    pub fact: Fact,
    /// The axioms of a layer are applied after those of smaller ones.
    pub layer: u32,
}

/// A planning task.
#[derive(Debug, Clone, Default)]
pub struct Task {
    /// The first fact of each variable, and the number of facts after the last.
    pub offsets: Vec<Fact>,
    /// The variable of each fact.
    pub variables: Vec<u32>,
    /// The values of the variables at first, as facts; derived variables have their first values. The words of the
    /// numeric variables follow.
    pub init: Vec<Fact>,
    /// What is to hold: at most one fact of each variable, in order.
    pub goal: Vec<Fact>,
    /// The actions.
    pub operators: Vec<Operator>,
    /// The rules for derived variables, by layers.
    pub axioms: Vec<Axiom>,
    /// Which variables are derived.
    pub is_derived: Vec<bool>,
    /// Sets of facts of which at most one is true at a time, besides those of one variable.
    pub mutexes: Vec<Vec<Fact>>,
    /// The predicate of each fact; none for facts that stand for "none of the others".
    pub predicates: Vec<Option<u32>>,
    /// Rules that hold only in the relaxed task: how a derived fact may become false.
    pub relaxed: Vec<(Vec<Fact>, Fact)>,
    /// How many facts there are, with those that only the relaxed task has.
    pub relaxed_facts: usize,
    /// The words of which names are made.
    pub words: Vec<String>,
    /// Whether plans are measured by their costs.
    pub has_costs: bool,
    /// Whether costs stand for a metric that is more than their sum.
    pub is_weighted: bool,
    /// Numeric variables and what compares them.
    pub numbers: Numbers,
}

impl Task {
    /// Returns how many facts there are.
    #[must_use]
    pub fn facts(&self) -> usize {
        self.variables.len()
    }

    /// Returns how many variables there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.is_derived.len()
    }

    /// Whether there are no variables.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.is_derived.is_empty()
    }

    /// Returns the variable of a fact.
    #[must_use]
    pub fn variable(&self, fact: Fact) -> usize {
        self.variables[fact as usize] as usize
    }

    /// Returns the facts of a variable.
    #[must_use]
    pub fn domain(&self, variable: usize) -> std::ops::Range<Fact> {
        self.offsets[variable]..self.offsets[variable + 1]
    }

    /// Returns an operator's name and arguments.
    pub fn name(&self, operator: OperatorId) -> impl Iterator<Item = &str> {
        self.operators[operator as usize].name.iter().map(|word| self.words[*word as usize].as_str())
    }

    /// Whether an operator costs less than nothing, or what cannot be computed.
    pub fn has_gains(&self) -> bool {
        self.operators.iter().any(|operator| operator.cost.is_nan() || operator.cost < 0.0)
    }

    /// Returns the sum of the costs of a plan.
    #[must_use]
    pub fn cost(&self, plan: &[OperatorId]) -> f64 {
        // The sum of nothing would be a negative zero.
        plan.iter().fold(0.0, |sum, operator| sum + self.operators[*operator as usize].cost)
    }
}
