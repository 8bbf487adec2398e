//! Conditional effects at the end of an action whose conditions are about other moments too.

use super::change::{Changes, happens_at, looks_elsewhere};
use super::error::EvaluationError;
use super::record::Pending;
use super::state::{Bindings, State};
use super::truth::at_moment;
use crate::formats::pddl::ast::Moment;
use crate::pddl::model::Change;

impl State<'_> {
    /// Begins to watch the conditional effects at the end of an action whose conditions are about other moments too.
    pub(super) fn pend(
        &mut self,
        change: &Change,
        step: usize,
        bindings: &mut Bindings,
    ) -> Result<(), EvaluationError> {
        let mut pending = Vec::new();
        self.find_pending(change, bindings, &mut pending)?;
        if !pending.is_empty() {
            self.pending.insert(step, pending);
        }
        Ok(())
    }

    pub(super) fn find_pending(
        &self,
        change: &Change,
        bindings: &mut Bindings,
        pending: &mut Vec<Pending>,
    ) -> Result<(), EvaluationError> {
        match change {
            Change::And(parts) => parts.iter().try_for_each(|part| self.find_pending(part, bindings, pending)),
            Change::Forall(quantifier, inner) => self
                .each(quantifier, bindings, |bindings| {
                    self.find_pending(inner, bindings, pending)?;
                    Ok(false)
                })
                .map(drop),
            Change::Timed(Moment::End, inner) => self.find_pending(inner, bindings, pending),
            Change::When(condition, effect)
                if looks_elsewhere(condition, Moment::End) && happens_at(effect, Moment::End) =>
            {
                let holds = self.is_true(&at_moment(condition, Moment::Start), bindings)?;
                let (condition, effect, bindings) = ((**condition).clone(), (**effect).clone(), bindings.clone());
                pending.push(Pending { condition, effect, bindings, holds });
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Adds what the effects do that waited for the end of an action.
    pub(super) fn end_pending(&mut self, step: usize, changes: &mut Changes) -> Result<(), EvaluationError> {
        for Pending { condition, effect, mut bindings, holds } in self.pending.remove(&step).unwrap_or_default() {
            if holds && self.is_true(&at_moment(&condition, Moment::End), &mut bindings)? {
                let ended = self.changes(&effect, Some(Moment::End), &mut bindings)?;
                changes.join(ended, self)?;
            }
        }
        Ok(())
    }
}
