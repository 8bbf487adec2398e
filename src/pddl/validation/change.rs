//! What an effect changes, collected before anything is changed.

use std::collections::{HashMap, HashSet};

use super::error::EvaluationError;
use super::state::{Bindings, Ground, State};
use crate::formats::pddl::ast::{Assigner, Moment};
use crate::pddl::model::{Change, Formula, Number};

/// Changes that take place at once.
#[derive(Debug, Default)]
pub(super) struct Changes {
    pub(super) adds: HashSet<Ground>,
    pub(super) deletes: HashSet<Ground>,
    pub(super) values: HashMap<Ground, Update>,
}

/// What happens to one number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Update {
    Assign(f64),
    /// Increased, or decreased where negative.
    Shift(f64),
    Scale(f64),
}

impl Changes {
    /// Adds the changes of another action to these.
    pub(super) fn join(&mut self, other: Self, state: &State<'_>) -> Result<(), EvaluationError> {
        self.adds.extend(other.adds);
        self.deletes.extend(other.deletes);
        other.values.into_iter().try_for_each(|(fluent, update)| self.update(fluent, update, state))
    }

    fn update(&mut self, fluent: Ground, update: Update, state: &State<'_>) -> Result<(), EvaluationError> {
        let joined = match (self.values.get(&fluent), update) {
            (None, update) => update,
            (Some(Update::Shift(one)), Update::Shift(other)) => Update::Shift(one + other),
            (Some(Update::Assign(one)), Update::Assign(other)) if *one == other => update,
            _ => {
                let text = state.ground_function_text(&fluent);
                return Err(EvaluationError::Wrong(format!("{text} is changed in two ways at once")));
            }
        };
        self.values.insert(fluent, joined);
        Ok(())
    }
}

impl State<'_> {
    /// What `change` does in this state. With a moment, only what happens then.
    pub(super) fn changes(
        &self,
        change: &Change,
        moment: Option<Moment>,
        bindings: &mut Bindings,
    ) -> Result<Changes, EvaluationError> {
        let mut changes = Changes::default();
        // What names no moment happens at once: always in an action, at the end in a durative one.
        let now = moment.is_none_or(|moment| moment == Moment::End);
        self.collect(change, moment, now, bindings, &mut changes)?;
        Ok(changes)
    }

    fn collect(
        &self,
        change: &Change,
        moment: Option<Moment>,
        now: bool,
        bindings: &mut Bindings,
        changes: &mut Changes,
    ) -> Result<(), EvaluationError> {
        match change {
            Change::And(parts) => parts.iter().try_for_each(|part| self.collect(part, moment, now, bindings, changes)),
            Change::Timed(when, inner) => self.collect(inner, moment, moment == Some(*when), bindings, changes),
            Change::Forall(quantifier, inner) => self
                .each(quantifier, bindings, |bindings| {
                    self.collect(inner, moment, now, bindings, changes)?;
                    Ok(false)
                })
                .map(drop),
            Change::When(condition, inner) => {
                match moment {
                    // What depends on the start and the course of the action happens when that is known.
                    Some(Moment::Start) if !now && !happens_at(inner, Moment::Start) => return Ok(()),
                    Some(Moment::End) if !now || !happens_at(inner, Moment::End) => return Ok(()),
                    Some(Moment::End) if looks_elsewhere(condition, Moment::End) => {
                        return match is_conditional(inner) {
                            false => Ok(()),
                            true => Err(unchecked("conditional effects in one that looks at another moment")),
                        };
                    }
                    Some(moment) if looks_elsewhere(condition, moment) => {
                        return Err(unchecked("conditional effects that look at a later moment"));
                    }
                    _ => {}
                }
                if self.is_true(condition, bindings)? {
                    self.collect(inner, moment, now, bindings, changes)?;
                }
                Ok(())
            }
            _ if !now => Ok(()),
            Change::Add(fact) => {
                changes.adds.insert(self.ground(fact.predicate, &fact.arguments, bindings)?);
                Ok(())
            }
            Change::Delete(fact) => {
                changes.deletes.insert(self.ground(fact.predicate, &fact.arguments, bindings)?);
                Ok(())
            }
            Change::Assign(assigner, fluent, value) => {
                let fluent = self.ground(fluent.function, &fluent.arguments, bindings)?;
                let value = self.number(value, bindings)?;
                changes.update(fluent, update(*assigner, value)?, self)
            }
            Change::AssignObject => Err(EvaluationError::Unchecked("object fluents are not simulated".to_owned())),
        }
    }

    /// Lets changes happen; what is both added and deleted is there afterwards.
    pub(super) fn apply(&mut self, changes: Changes) -> Result<(), EvaluationError> {
        let is_looked_at = |fact: &Ground| fact.first().is_some_and(|predicate| self.looked_at.contains(predicate));
        let touches = changes.adds.iter().chain(&changes.deletes).any(is_looked_at);
        if touches || (self.rules_compute && !changes.values.is_empty()) {
            self.derived.replace(None);
        }
        for fact in &changes.deletes {
            self.facts.remove(fact);
        }
        changes.adds.into_iter().for_each(|fact| self.facts.insert(fact));
        for (fluent, update) in changes.values {
            let before = self.value_before(&fluent, update)?;
            let after = match update {
                Update::Assign(value) => value,
                Update::Shift(value) => before + value,
                Update::Scale(value) => before * value,
            };
            self.values.insert(fluent, after);
        }
        Ok(())
    }

    fn value_before(&self, fluent: &Ground, update: Update) -> Result<f64, EvaluationError> {
        match (self.values.get(fluent), update) {
            (Some(value), _) => Ok(*value),
            (None, Update::Assign(_)) => Ok(0.0),
            (None, _) => Err(EvaluationError::Wrong(format!("{} has no value", self.ground_function_text(fluent)))),
        }
    }
}

fn update(assigner: Assigner, value: f64) -> Result<Update, EvaluationError> {
    Ok(match assigner {
        Assigner::Assign => Update::Assign(value),
        Assigner::Increase => Update::Shift(value),
        Assigner::Decrease => Update::Shift(-value),
        Assigner::ScaleUp => Update::Scale(value),
        Assigner::ScaleDown if value == 0.0 => return Err(EvaluationError::Wrong("a division by zero".to_owned())),
        Assigner::ScaleDown => Update::Scale(1.0 / value),
    })
}

fn unchecked(what: &str) -> EvaluationError {
    EvaluationError::Unchecked(format!("{what} are not simulated"))
}

/// Whether something of an effect happens at a moment; what names none happens at the end.
pub(super) fn happens_at(change: &Change, moment: Moment) -> bool {
    match change {
        Change::And(parts) => parts.iter().any(|part| happens_at(part, moment)),
        Change::Timed(when, _) => *when == moment,
        Change::Forall(_, inner) | Change::When(_, inner) => happens_at(inner, moment),
        Change::Add(_) | Change::Delete(_) | Change::Assign(..) | Change::AssignObject => moment == Moment::End,
    }
}

/// Whether an effect depends on a condition.
fn is_conditional(change: &Change) -> bool {
    match change {
        Change::When(..) => true,
        Change::And(parts) => parts.iter().any(is_conditional),
        Change::Forall(_, inner) | Change::Timed(_, inner) => is_conditional(inner),
        Change::Add(_) | Change::Delete(_) | Change::Assign(..) | Change::AssignObject => false,
    }
}

/// Whether a condition is about another moment than this.
pub(super) fn looks_elsewhere(condition: &Formula, moment: Moment) -> bool {
    match condition {
        Formula::Timed(other, _) => *other != moment,
        Formula::And(parts) | Formula::Or(parts) => parts.iter().any(|part| looks_elsewhere(part, moment)),
        Formula::Not(inner) | Formula::Forall(_, inner) | Formula::Exists(_, inner) => looks_elsewhere(inner, moment),
        Formula::Imply(left, right) => looks_elsewhere(left, moment) || looks_elsewhere(right, moment),
        _ => false,
    }
}

/// An effect without what it does to numbers.
pub(super) fn without_numbers(change: &Change) -> Change {
    let inner = |inner: &Change| Box::new(without_numbers(inner));
    match change {
        Change::And(parts) => Change::And(parts.iter().map(without_numbers).collect()),
        Change::Forall(quantifier, change) => Change::Forall(quantifier.clone(), inner(change)),
        Change::When(condition, change) => Change::When(condition.clone(), inner(change)),
        Change::Timed(moment, change) => Change::Timed(*moment, inner(change)),
        Change::Assign(..) | Change::AssignObject => Change::And(Vec::new()),
        Change::Add(_) | Change::Delete(_) => change.clone(),
    }
}

/// Whether an effect happens little by little.
pub(super) fn is_continuous(change: &Change) -> bool {
    match change {
        Change::And(parts) => parts.iter().any(is_continuous),
        Change::Forall(_, inner) | Change::When(_, inner) | Change::Timed(_, inner) => is_continuous(inner),
        Change::Assign(_, _, value) => has_elapsed(value),
        _ => false,
    }
}

fn has_elapsed(number: &Number) -> bool {
    match number {
        Number::Elapsed => true,
        Number::Operation(_, operands) => operands.iter().any(has_elapsed),
        _ => false,
    }
}
