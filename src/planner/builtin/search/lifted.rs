//! A classical planning task before it is grounded: types, predicates, action schemas and axioms.
//!
//! Everything is numbered. The variables of a schema are its slots: first the parameters, then the variables
//! of its quantifiers, each with a slot of its own.

use super::number::{Change, Comparator};

/// The number of an object.
pub type Object = u32;

/// A variable or an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Term {
    /// A slot of the schema.
    Slot(usize),
    /// An object.
    Object(Object),
}

/// A predicate with its terms.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Atom {
    /// The number of the predicate.
    pub predicate: usize,
    /// As many as the predicate takes.
    pub terms: Vec<Term>,
}

/// A formula in negation normal form.
#[derive(Debug, Clone, PartialEq)]
pub enum Condition {
    /// Always true.
    True,
    /// Never true.
    False,
    /// An atom or its negation.
    Literal(Atom, bool),
    /// Whether two terms are the same object, or are not.
    Equal(Term, Term, bool),
    /// All of them.
    And(Vec<Self>),
    /// At least one of them.
    Or(Vec<Self>),
    /// For all objects in the slots.
    Forall(Vec<usize>, Box<Self>),
    /// For at least one object in each slot.
    Exists(Vec<usize>, Box<Self>),
    /// How two numbers compare, or do not (`true`).
    Compare(Comparator, Amount, Amount, bool),
}

/// What an action changes, where a condition holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// The slots that stand for every object of their types.
    pub slots: Vec<usize>,
    /// What must hold before the action.
    pub condition: Condition,
    /// What becomes true or false.
    pub atom: Atom,
    /// Whether it becomes true.
    pub adds: bool,
}

/// How an action changes a number, where a condition holds.
#[derive(Debug, Clone, PartialEq)]
pub struct NumericEffect {
    /// The slots that stand for every object of their types.
    pub slots: Vec<usize>,
    /// What must hold before the action.
    pub condition: Condition,
    /// The function whose value changes.
    pub function: usize,
    /// Its terms.
    pub terms: Vec<Term>,
    /// In which way it changes.
    pub change: Change,
    /// By how much, before the action.
    pub amount: Amount,
}

/// An arithmetic expression.
#[derive(Debug, Clone, PartialEq)]
pub enum Amount {
    /// A number.
    Number(f64),
    /// The value of a function; in a cost, one that no action changes.
    Function(usize, Vec<Term>),
    /// The sum of all.
    Sum(Vec<Self>),
    /// The product of both.
    Product(Box<Self>, Box<Self>),
    /// The first divided by the second.
    Quotient(Box<Self>, Box<Self>),
}

/// An action schema.
#[derive(Debug, Clone, PartialEq)]
pub struct Schema {
    /// The name, as plans spell it.
    pub name: String,
    /// How many of the slots are parameters.
    pub parameters: usize,
    /// The type of each slot.
    pub slots: Vec<usize>,
    /// When it is applicable.
    pub condition: Condition,
    /// What it changes.
    pub effects: Vec<Effect>,
    /// Which numbers it changes.
    pub numeric: Vec<NumericEffect>,
    /// What it costs.
    pub cost: Amount,
}

/// A rule for a derived predicate.
#[derive(Debug, Clone, PartialEq)]
pub struct Axiom {
    /// What is derived.
    pub head: Atom,
    /// The type of each slot.
    pub slots: Vec<usize>,
    /// From what.
    pub condition: Condition,
}

/// The whole task.
#[derive(Debug, Clone, Default)]
pub struct Lifted {
    /// The names of the objects.
    pub objects: Vec<String>,
    /// The objects of each type, in order.
    pub types: Vec<Vec<Object>>,
    /// The names of the predicates and how many terms they take.
    pub predicates: Vec<(String, usize)>,
    /// The action schemas.
    pub schemas: Vec<Schema>,
    /// The rules for derived predicates.
    pub axioms: Vec<Axiom>,
    /// What is true at first.
    pub init: Vec<(usize, Vec<Object>)>,
    /// The names of the functions.
    pub functions: Vec<String>,
    /// The values of functions at first.
    pub values: Vec<((usize, Vec<Object>), f64)>,
    /// What is to become true.
    pub goal: Condition,
    /// The types of the goal's slots.
    pub goal_slots: Vec<usize>,
    /// Whether plans are measured by the cost of their actions, not by their number.
    pub has_costs: bool,
    /// Whether costs stand for a metric that is more than their sum.
    pub is_weighted: bool,
    /// Whether operators that do the same are kept, not only the cheapest: where they overlap in time, it matters what each
    /// occupies.
    pub keeps_equals: bool,
    /// Whether conditions compare numbers.
    pub has_numbers: bool,
}

impl Default for Condition {
    fn default() -> Self {
        Self::And(Vec::new())
    }
}

impl Condition {
    /// Returns the conjunction, without nesting.
    #[must_use]
    pub fn all(parts: Vec<Self>) -> Self {
        let mut flat = Vec::new();
        for part in parts {
            match part {
                Self::True => {}
                Self::False => return Self::False,
                Self::And(inner) => flat.extend(inner),
                other => flat.push(other),
            }
        }
        match flat.len() {
            0 => Self::True,
            1 => flat.remove(0),
            _ => Self::And(flat),
        }
    }

    /// Returns the disjunction, without nesting.
    #[must_use]
    pub fn any(parts: Vec<Self>) -> Self {
        let mut flat = Vec::new();
        for part in parts {
            match part {
                Self::False => {}
                Self::True => return Self::True,
                Self::Or(inner) => flat.extend(inner),
                other => flat.push(other),
            }
        }
        match flat.len() {
            0 => Self::False,
            1 => flat.remove(0),
            _ => Self::Or(flat),
        }
    }

    /// Returns the conjuncts, where existential quantifiers around conjunctions are dropped: their variables
    /// become like parameters.
    #[must_use]
    pub fn conjuncts(&self) -> Vec<&Self> {
        match self {
            Self::And(parts) => parts.iter().flat_map(Self::conjuncts).collect(),
            Self::Exists(_, inner) => inner.conjuncts(),
            Self::True => Vec::new(),
            other => vec![other],
        }
    }

    /// Returns the conditions that this one is the disjunction of: one for each part of its shortest disjunction, where
    /// that has at most so many.
    #[must_use]
    pub fn cases(&self, most: usize) -> Vec<Self> {
        let parts = self.conjuncts();
        let disjunctions = parts.iter().enumerate().filter_map(|(place, part)| match part {
            Self::Or(cases) if cases.len() <= most => Some((cases.len(), place, cases)),
            _ => None,
        });
        let Some((_, chosen, cases)) = disjunctions.min_by_key(|(count, ..)| *count) else {
            return vec![self.clone()];
        };
        let rest = parts.iter().enumerate().filter(|(place, _)| *place != chosen).map(|(_, part)| (*part).clone());
        let rest: Vec<Self> = rest.collect();
        cases.iter().map(|case| Self::all([rest.as_slice(), std::slice::from_ref(case)].concat())).collect()
    }

    /// Returns the slots of the quantifiers that [`Self::conjuncts`] drops.
    #[must_use]
    pub fn hoisted(&self) -> Vec<usize> {
        match self {
            Self::And(parts) => parts.iter().flat_map(Self::hoisted).collect(),
            Self::Exists(slots, inner) => slots.iter().copied().chain(inner.hoisted()).collect(),
            _ => Vec::new(),
        }
    }
}
