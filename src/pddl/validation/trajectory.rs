//! Trajectory constraints: what `:constraints` demands of the states that a plan goes through.
//!
//! The semantics are those of PDDL 3 (Gerevini and Long 2005, "Plan Constraints and Preferences in PDDL3"): a trajectory is
//! the initial state at time 0 and the state after each moment at which something happens. Each constraint keeps
//! what it needs of the states so far, so that none of them is kept.

use std::sync::Arc;

use super::error::EvaluationError;
use super::state::{Bindings, State, TOLERANCE};
use super::truth::at_moment;
use crate::formats::pddl::ast::{Modal, Moment};
use crate::pddl::model::Formula;

/// All constraints of a task, and what they have seen.
#[derive(Default)]
pub(super) struct Trajectory {
    monitors: Vec<Monitor>,
    /// The names of the preferences among the constraints, where they have one.
    preferences: Vec<Option<Arc<str>>>,
    /// Why a constraint cannot be checked, where that is so.
    pub(super) unchecked: Option<String>,
}

/// One constraint with values for its variables.
struct Monitor {
    formula: Formula,
    bindings: Bindings,
    /// The preference it belongs to; none where every plan has to satisfy it.
    preference: Option<usize>,
    progress: Progress,
    is_broken: bool,
}

/// What a constraint keeps of the states so far.
#[derive(Default)]
struct Progress {
    /// Whether the first condition held in the last state, or so far, as the operator needs it.
    first: bool,
    /// Whether the second condition held so far, or the first condition ended to hold, or its time has begun.
    second: bool,
    /// Since when the second condition is waited for.
    since: Option<f64>,
}

impl Trajectory {
    /// The constraints of domain and problem.
    pub(super) fn new(state: &State<'_>) -> Self {
        let mut trajectory = Self::default();
        for constraints in [&state.domain.constraints, &state.problem.constraints] {
            match trajectory.collect(constraints, None, &mut Bindings::new(), state) {
                Err(EvaluationError::Unchecked(reason) | EvaluationError::Wrong(reason)) => {
                    trajectory.unchecked.get_or_insert(reason);
                }
                Ok(()) => {}
            }
        }
        trajectory
    }

    fn collect(
        &mut self,
        formula: &Formula,
        preference: Option<usize>,
        bindings: &mut Bindings,
        state: &State<'_>,
    ) -> Result<(), EvaluationError> {
        match formula {
            Formula::And(parts) => parts.iter().try_for_each(|part| self.collect(part, preference, bindings, state)),
            Formula::Forall(quantifier, inner) => state
                .each(quantifier, bindings, |bindings| {
                    self.collect(inner, preference, bindings, state)?;
                    Ok(false)
                })
                .map(drop),
            Formula::Preference(name, inner) if preference.is_none() => {
                self.preferences.push(name.clone());
                self.collect(inner, Some(self.preferences.len() - 1), bindings, state)
            }
            Formula::Modal(_, _, parts) if parts.iter().all(is_of_one_state) => {
                self.watch(formula, preference, bindings);
                Ok(())
            }
            Formula::Timed(Moment::End, inner) if is_of_one_state(inner) => {
                self.watch(formula, preference, bindings);
                Ok(())
            }
            other => {
                let text = state.text(other, bindings);
                Err(EvaluationError::Unchecked(format!("the constraint {text} is not simulated")))
            }
        }
    }

    fn watch(&mut self, formula: &Formula, preference: Option<usize>, bindings: &Bindings) {
        self.monitors.push(Monitor {
            formula: formula.clone(),
            bindings: bindings.clone(),
            preference,
            progress: Progress::default(),
            is_broken: false,
        });
    }

    /// Shows the state to all constraints. Returns the first that every plan has to satisfy and that no end of the
    /// plan can satisfy any more.
    pub(super) fn see(&mut self, state: &State<'_>) -> Result<Option<String>, EvaluationError> {
        let mut broken = None;
        for monitor in self.monitors.iter_mut().filter(|monitor| !monitor.is_broken) {
            monitor.see(state)?;
            if monitor.is_broken && monitor.preference.is_none() {
                broken.get_or_insert_with(|| monitor.text(state));
            }
        }
        Ok(broken)
    }

    /// Ends the trajectory. Returns the first constraint that every plan has to satisfy and this one does not, and the
    /// names of the preferences that are violated.
    pub(super) fn end(&mut self, state: &State<'_>) -> (Option<String>, Vec<Arc<str>>) {
        let mut violated = vec![false; self.preferences.len()];
        let mut broken = None;
        for monitor in &self.monitors {
            if monitor.is_satisfied() {
                continue;
            }
            match monitor.preference.and_then(|place| violated.get_mut(place)) {
                Some(violated) => *violated = true,
                None => {
                    broken.get_or_insert_with(|| monitor.text(state));
                }
            }
        }
        let names = self.preferences.iter().zip(violated).filter(|(_, violated)| *violated);
        (broken, names.filter_map(|(name, _)| name.clone()).collect())
    }
}

impl Monitor {
    fn text(&self, state: &State<'_>) -> String {
        state.text(&self.formula, &self.bindings)
    }

    fn see(&mut self, state: &State<'_>) -> Result<(), EvaluationError> {
        let (modal, numbers, parts) = match &self.formula {
            Formula::Modal(modal, numbers, parts) => (*modal, numbers.as_slice(), parts.as_slice()),
            other => {
                self.progress.first = state.is_true(&at_moment(other, Moment::End), &mut self.bindings)?;
                return Ok(());
            }
        };
        let time = state.time;
        let number = |place: usize| numbers.get(place).copied().unwrap_or_default();
        let holds =
            |place: usize, bindings: &mut Bindings| match parts.get(place).map(|part| state.is_true(part, bindings)) {
                // A comparison with what has no value in this state does not hold in it.
                None | Some(Err(EvaluationError::Wrong(_))) => Ok(false),
                Some(known) => known,
            };
        let first = holds(0, &mut self.bindings)?;
        let second = parts.len() > 1 && holds(1, &mut self.bindings)?;
        let progress = &mut self.progress;
        match modal {
            Modal::Always => self.is_broken = !first,
            Modal::Sometime => progress.first |= first,
            Modal::Within => progress.first |= first && time <= number(0) + TOLERANCE,
            Modal::AtMostOnce => {
                self.is_broken = first && progress.second;
                progress.second |= progress.first && !first;
                progress.first |= first;
            }
            Modal::SometimeAfter => {
                progress.since = match progress.since {
                    _ if second => None,
                    None if first => Some(time),
                    since => since,
                };
            }
            Modal::SometimeBefore => {
                self.is_broken = first && !progress.second;
                progress.second |= second;
            }
            Modal::AlwaysWithin => {
                if first {
                    progress.since.get_or_insert(time);
                }
                self.is_broken = progress.since.is_some_and(|since| time - since > number(0) + TOLERANCE);
                if second {
                    progress.since = None;
                }
            }
            // What holds at a time is what the last moment before it left.
            Modal::HoldAfter | Modal::HoldDuring if time <= number(0) + TOLERANCE => progress.first = first,
            Modal::HoldAfter | Modal::HoldDuring => {
                let is_first = !std::mem::replace(&mut progress.second, true);
                let is_over = modal == Modal::HoldDuring && time >= number(1) - TOLERANCE;
                self.is_broken = (is_first && !progress.first) || (!is_over && !first);
            }
        }
        Ok(())
    }

    /// Whether the states so far, as a whole plan, satisfy the constraint.
    fn is_satisfied(&self) -> bool {
        let Progress { first, since, .. } = &self.progress;
        !self.is_broken
            && match &self.formula {
                Formula::Modal(Modal::SometimeAfter | Modal::AlwaysWithin, ..) => since.is_none(),
                Formula::Modal(Modal::Always | Modal::AtMostOnce | Modal::SometimeBefore, ..) => true,
                _ => *first,
            }
    }
}

/// Whether a condition is about one state.
fn is_of_one_state(formula: &Formula) -> bool {
    match formula {
        Formula::And(parts) | Formula::Or(parts) => parts.iter().all(is_of_one_state),
        Formula::Imply(left, right) => is_of_one_state(left) && is_of_one_state(right),
        Formula::Not(inner) | Formula::Forall(_, inner) | Formula::Exists(_, inner) => is_of_one_state(inner),
        Formula::Fact(_) | Formula::Same(..) | Formula::Compare(..) => true,
        Formula::Timed(..) | Formula::Preference(..) | Formula::Modal(..) => false,
    }
}
