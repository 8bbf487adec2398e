//! The numeric variables and comparisons of a ground task. What no action changes is a number.

use super::super::hash::NumberMap;
use super::super::lifted::{Amount, Lifted, Object, Term};
use super::super::number::{Comparator, Expression};

/// A comparison, and the atom that stands for it.
#[derive(Debug, Clone)]
pub(super) struct Compared {
    pub(super) atom: u32,
    pub(super) comparator: Comparator,
    pub(super) left: Expression,
    pub(super) right: Expression,
}

/// The variables and comparisons that have been met so far.
#[derive(Default)]
pub(super) struct Ledger {
    /// Which functions actions change.
    is_changed: Vec<bool>,
    values: NumberMap<(usize, Vec<Object>), f64>,
    variables: NumberMap<(usize, Vec<Object>), u32>,
    /// The value of each variable at first; not a number where it has none.
    pub(super) init: Vec<f64>,
    atoms: NumberMap<Vec<u64>, u32>,
    pub(super) comparisons: Vec<Compared>,
}

impl Ledger {
    pub(super) fn new(lifted: &Lifted) -> Self {
        let mut ledger = Self::default();
        ledger.values.extend(lifted.values.iter().cloned());
        for effect in lifted.schemas.iter().flat_map(|schema| &schema.numeric) {
            if effect.function >= ledger.is_changed.len() {
                ledger.is_changed.resize(effect.function + 1, false);
            }
            ledger.is_changed[effect.function] = true;
        }
        ledger
    }

    /// Returns a cost; `None` where a function has no value.
    pub(super) fn cost(&self, amount: &Amount, binding: &[Object]) -> Option<f64> {
        amount.value(binding, &|function, objects| self.values.get(&(function, objects)).copied())
    }

    /// Returns the variable of a function that actions change.
    pub(super) fn variable(&mut self, function: usize, terms: &[Term], binding: &[Object]) -> u32 {
        let key = (function, terms.iter().map(|term| object(*term, binding)).collect::<Vec<_>>());
        let next = self.init.len() as u32;
        if let Some(known) = self.variables.get(&key) {
            return *known;
        }
        self.init.push(self.values.get(&key).copied().unwrap_or(f64::NAN));
        self.variables.insert(key, next);
        next
    }

    /// Returns an expression, with numbers for what does not change; `None` where something has no value, ever.
    pub(super) fn expression(&mut self, amount: &Amount, binding: &[Object]) -> Option<Expression> {
        let whole = match amount {
            Amount::Number(number) => Expression::Number(*number),
            Amount::Function(function, terms) => match self.is_changed.get(*function) {
                Some(true) => Expression::Variable(self.variable(*function, terms, binding)),
                _ => Expression::Number(self.cost(amount, binding)?),
            },
            Amount::Sum(parts) => {
                let parts = parts.iter().map(|part| self.expression(part, binding));
                Expression::Sum(parts.collect::<Option<_>>()?)
            }
            Amount::Product(left, right) => {
                let (left, right) = (self.expression(left, binding)?, self.expression(right, binding)?);
                Expression::Product(Box::new(left), Box::new(right))
            }
            Amount::Quotient(left, right) => {
                let (left, right) = (self.expression(left, binding)?, self.expression(right, binding)?);
                Expression::Quotient(Box::new(left), Box::new(right))
            }
        };
        match whole.constant() {
            Some(number) => number.is_finite().then_some(Expression::Number(number)),
            None => Some(whole),
        }
    }

    /// The function and the objects of each variable.
    pub(super) fn keys(&self) -> Vec<(usize, Vec<Object>)> {
        let mut keys = vec![(0, Vec::new()); self.init.len()];
        self.variables.iter().for_each(|(key, variable)| keys[*variable as usize].clone_from(key));
        keys
    }

    /// Whether a variable has no value at first.
    pub(super) fn lacks(&self, variable: u32) -> bool {
        self.init[variable as usize].is_nan()
    }

    /// Whether a comparison holds at first; `None` where it cannot be computed.
    pub(super) fn outcome(&self, compared: &Compared) -> Option<bool> {
        let value = |variable: u32| self.init[variable as usize];
        compared.comparator.outcome(compared.left.value(&value), compared.right.value(&value))
    }

    /// Returns the atom of a comparison, which is `next` where it is a new one.
    pub(super) fn atom(&mut self, comparator: Comparator, left: Expression, right: Expression, next: u32) -> u32 {
        let mut key = vec![comparator as u64];
        write(&left, &mut key);
        write(&right, &mut key);
        if let Some(known) = self.atoms.get(&key) {
            return *known;
        }
        self.atoms.insert(key, next);
        self.comparisons.push(Compared { atom: next, comparator, left, right });
        next
    }
}

/// Writes an expression as words that no other expression has.
fn write(expression: &Expression, words: &mut Vec<u64>) {
    match expression {
        Expression::Number(number) => words.extend([0, number.to_bits()]),
        Expression::Variable(variable) => words.extend([1, u64::from(*variable)]),
        Expression::Sum(parts) => {
            words.extend([2, parts.len() as u64]);
            parts.iter().for_each(|part| write(part, words));
        }
        Expression::Product(left, right) | Expression::Quotient(left, right) => {
            words.push(if matches!(expression, Expression::Product(..)) { 3 } else { 4 });
            write(left, words);
            write(right, words);
        }
    }
}

/// The object that a term is.
pub(super) fn object(term: Term, binding: &[Object]) -> Object {
    match term {
        Term::Slot(slot) => binding[slot],
        Term::Object(object) => object,
    }
}
