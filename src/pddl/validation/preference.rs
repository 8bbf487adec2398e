//! Preferences: how often each is violated, for metrics that count that (`is-violated`).
//!
//! As PDDL 3 has it (Gerevini and Long 2005), a preference in a goal counts once for each choice of objects for the
//! quantifiers around it, one in a precondition once for each step in which it does not hold, and one in
//! `:constraints` once.

use std::sync::Arc;

use super::error::EvaluationError;
use super::record::Violations;
use super::state::{Bindings, State};
use super::truth::at_moment;
use crate::formats::pddl::ast::Moment;
use crate::pddl::model::Formula;

/// A preference of a condition, with values for the variables around it.
struct Found<'f> {
    name: &'f Arc<str>,
    condition: &'f Formula,
    /// The moment it is about, where that is said around it.
    moment: Option<Moment>,
    bindings: Bindings,
}

impl State<'_> {
    /// Counts the named preferences of a condition that do not hold, each once for a step. With a moment, only what is about
    /// that.
    pub(super) fn count_violations(
        &mut self,
        condition: &Formula,
        moment: Option<Moment>,
        bindings: &Bindings,
        step: Option<usize>,
    ) -> Result<(), EvaluationError> {
        let Some(mut violations) = self.violations.take() else { return Ok(()) };
        let result = self.count_into(&mut violations, condition, moment, bindings, step);
        self.violations = Some(violations);
        result
    }

    fn count_into(
        &self,
        violations: &mut Violations,
        condition: &Formula,
        moment: Option<Moment>,
        bindings: &Bindings,
        step: Option<usize>,
    ) -> Result<(), EvaluationError> {
        let mut found = Vec::new();
        self.preferences(condition, None, &mut bindings.clone(), &mut found)?;
        for (place, mut preference) in found.into_iter().enumerate() {
            let part = match (preference.moment, moment) {
                (Some(about), Some(moment)) if about != moment => continue,
                (None, Some(moment)) => at_moment(preference.condition, moment),
                _ => preference.condition.clone(),
            };
            let holds = match self.is_true(&part, &mut preference.bindings) {
                // What cannot be computed does not hold.
                Err(EvaluationError::Wrong(_)) => false,
                other => other?,
            };
            if !holds && violations.counted.insert((step, place)) {
                violations.add(preference.name);
            }
        }
        Ok(())
    }

    fn preferences<'f>(
        &self,
        formula: &'f Formula,
        moment: Option<Moment>,
        bindings: &mut Bindings,
        found: &mut Vec<Found<'f>>,
    ) -> Result<(), EvaluationError> {
        match formula {
            Formula::And(parts) => parts.iter().try_for_each(|part| self.preferences(part, moment, bindings, found)),
            Formula::Timed(about, inner) => self.preferences(inner, Some(*about), bindings, found),
            Formula::Forall(quantifier, inner) => self
                .each(quantifier, bindings, |bindings| {
                    self.preferences(inner, moment, bindings, found)?;
                    Ok(false)
                })
                .map(drop),
            Formula::Preference(Some(name), condition) => {
                found.push(Found { name, condition, moment, bindings: bindings.clone() });
                Ok(())
            }
            _ => Ok(()),
        }
    }
}
