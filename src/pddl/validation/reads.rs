//! The facts and numbers that conditions and effects look at.

use std::collections::HashSet;

use super::change::looks_elsewhere;
use super::error::EvaluationError;
use super::state::{Bindings, Ground, State};
use super::truth::at_moment;
use crate::formats::pddl::ast::Moment;
use crate::pddl::model::{Change, Formula, Number, Variable};

/// How many facts derived predicates may look at where several things happen at one moment.
const READS: usize = 1_000_000;

impl State<'_> {
    /// Adds what the derived predicates that are looked at look at themselves, through all rules.
    pub(super) fn derived_reads(&self, reads: &mut HashSet<Ground>) -> Result<(), EvaluationError> {
        let is_derived = |fact: &Ground| fact.first().is_some_and(|head| self.domain.derived.contains(head));
        let mut todo: Vec<Ground> = reads.iter().filter(|fact| is_derived(fact)).cloned().collect();
        while let Some(fact) = todo.pop() {
            let objects = fact.get(1..).unwrap_or_default();
            for rule in self.domain.rules.iter().filter(|rule| fact.first() == Some(&rule.predicate)) {
                let fits = |(object, variable): (&u32, &Variable)| self.is_member(*object, &variable.kind);
                if !objects.iter().zip(&rule.variables).all(fits) {
                    continue;
                }
                let mut found = HashSet::new();
                self.reads(&rule.condition, &mut objects.to_vec(), &mut found)?;
                for fact in found {
                    if reads.insert(fact.clone()) && is_derived(&fact) {
                        todo.push(fact);
                    }
                }
            }
            if reads.len() > READS {
                let reason = "what derived predicates look at while other things happen is too much to compare";
                return Err(EvaluationError::Unchecked(reason.to_owned()));
            }
        }
        Ok(())
    }

    /// The facts and values that a condition looks at. Under a derived predicate, that is the predicate itself.
    pub(super) fn reads(
        &self,
        formula: &Formula,
        bindings: &mut Bindings,
        reads: &mut HashSet<Ground>,
    ) -> Result<(), EvaluationError> {
        match formula {
            Formula::Fact(fact) => {
                reads.insert(self.ground(fact.predicate, &fact.arguments, bindings)?);
                Ok(())
            }
            Formula::Compare(_, left, right) => {
                self.number_reads(left, bindings, reads)?;
                self.number_reads(right, bindings, reads)
            }
            Formula::And(parts) | Formula::Or(parts) => {
                parts.iter().try_for_each(|part| self.reads(part, bindings, reads))
            }
            Formula::Imply(left, right) => {
                self.reads(left, bindings, reads)?;
                self.reads(right, bindings, reads)
            }
            Formula::Not(inner) | Formula::Timed(_, inner) => self.reads(inner, bindings, reads),
            Formula::Forall(quantifier, inner) | Formula::Exists(quantifier, inner) => self
                .each(quantifier, bindings, |bindings| {
                    self.reads(inner, bindings, reads)?;
                    Ok(false)
                })
                .map(drop),
            Formula::Same(..) | Formula::Preference(..) | Formula::Modal(..) => Ok(()),
        }
    }

    /// The facts and values that an effect looks at.
    pub(super) fn effect_reads(
        &self,
        change: &Change,
        moment: Option<Moment>,
        bindings: &mut Bindings,
        reads: &mut HashSet<Ground>,
    ) -> Result<(), EvaluationError> {
        match change {
            Change::And(parts) => parts.iter().try_for_each(|part| self.effect_reads(part, moment, bindings, reads)),
            Change::Timed(when, inner) if moment.is_none_or(|moment| moment == *when) => {
                self.effect_reads(inner, moment, bindings, reads)
            }
            Change::Forall(quantifier, inner) => self
                .each(quantifier, bindings, |bindings| {
                    self.effect_reads(inner, moment, bindings, reads)?;
                    Ok(false)
                })
                .map(drop),
            Change::When(condition, inner) => {
                match moment.filter(|moment| looks_elsewhere(condition, *moment)) {
                    Some(moment) => self.reads(&at_moment(condition, moment), bindings, reads)?,
                    None => self.reads(condition, bindings, reads)?,
                }
                self.effect_reads(inner, moment, bindings, reads)
            }
            Change::Assign(_, _, value) => self.number_reads(value, bindings, reads),
            Change::Timed(..) | Change::Add(_) | Change::Delete(_) | Change::AssignObject => Ok(()),
        }
    }

    fn number_reads(
        &self,
        number: &Number,
        bindings: &Bindings,
        reads: &mut HashSet<Ground>,
    ) -> Result<(), EvaluationError> {
        match number {
            Number::Fluent(fluent) => {
                let ground = self.ground(fluent.function, &fluent.arguments, bindings)?;
                reads.insert(function_key(&ground));
                Ok(())
            }
            Number::Operation(_, operands) => {
                operands.iter().try_for_each(|operand| self.number_reads(operand, bindings, reads))
            }
            _ => Ok(()),
        }
    }
}

/// A function among facts: its number is counted from the other end, so that it is not a predicate's.
pub(super) fn function_key(ground: &Ground) -> Ground {
    let mut key = ground.clone();
    if let Some(function) = key.first_mut() {
        *function = !*function;
    }
    key
}
