//! Which moments of a durative action its conditions and effects are about.

use crate::formats::Span;
use crate::formats::pddl::ast::{Condition, ConditionKind, Effect, EffectKind, Expression, Moment};

/// The moment that a condition and the effect under it are both about, and nothing else.
pub(crate) fn joint_moment(condition: &Condition, effect: &Effect) -> Option<Moment> {
    [Moment::Start, Moment::End]
        .into_iter()
        .find(|moment| is_only_about(condition, *moment) && happens_only_at(effect, *moment))
}

/// Whether a condition names a moment of a durative action.
pub(crate) fn names_moment(condition: &Condition) -> bool {
    named(condition).is_some()
}

/// Where a condition names a moment of a durative action first.
pub(crate) fn named(condition: &Condition) -> Option<Span> {
    match &condition.kind {
        ConditionKind::Timed(..) => Some(condition.place.0),
        ConditionKind::Atom(_) | ConditionKind::Comparison(..) | ConditionKind::Modal(..) => None,
        _ => parts(condition).into_iter().find_map(named),
    }
}

/// Where an effect names a moment of a durative action first, itself or in what it hangs on.
pub(crate) fn named_by(effect: &Effect) -> Option<Span> {
    match &effect.kind {
        EffectKind::Timed(..) => Some(effect.place.0),
        EffectKind::And(parts) => parts.iter().find_map(named_by),
        EffectKind::Forall(_, inner) => named_by(inner),
        EffectKind::When(condition, inner) => named(condition).or_else(|| named_by(inner)),
        EffectKind::Add(_) | EffectKind::Delete(_) | EffectKind::Assign(..) => None,
    }
}

/// Where a condition of a durative action first asks something and does not say at which moment.
pub(crate) fn unnamed(condition: &Condition) -> Option<Span> {
    match &condition.kind {
        ConditionKind::Timed(..) => None,
        ConditionKind::Atom(_) | ConditionKind::Comparison(..) | ConditionKind::Modal(..) => Some(condition.place.0),
        _ => parts(condition).into_iter().find_map(unnamed),
    }
}

/// Where an effect of a durative action first does something and does not say at which moment. A change that goes on over
/// its time, by `#t`, has none.
pub(crate) fn unnamed_by(effect: &Effect) -> Option<Span> {
    match &effect.kind {
        EffectKind::Timed(..) => None,
        EffectKind::And(parts) => parts.iter().find_map(unnamed_by),
        EffectKind::Forall(_, inner) | EffectKind::When(_, inner) => unnamed_by(inner),
        EffectKind::Assign(_, _, value) if has_elapsed(value) => None,
        EffectKind::Add(_) | EffectKind::Delete(_) | EffectKind::Assign(..) => Some(effect.place.0),
    }
}

fn has_elapsed(expression: &Expression) -> bool {
    match expression {
        Expression::Elapsed(_) => true,
        Expression::Operation(_, operands, _) => operands.iter().any(has_elapsed),
        Expression::Number(..) | Expression::Term(_) => false,
    }
}

/// The conditions that one is made of.
fn parts(condition: &Condition) -> Vec<&Condition> {
    match &condition.kind {
        ConditionKind::And(parts) | ConditionKind::Or(parts) | ConditionKind::Modal(_, _, parts) => {
            parts.iter().collect()
        }
        ConditionKind::Imply(left, right) => vec![&**left, &**right],
        ConditionKind::Not(inner)
        | ConditionKind::Forall(_, inner)
        | ConditionKind::Exists(_, inner)
        | ConditionKind::Timed(_, inner)
        | ConditionKind::Preference(_, inner) => vec![&**inner],
        ConditionKind::Atom(_) | ConditionKind::Comparison(..) => Vec::new(),
    }
}

fn is_only_about(condition: &Condition, moment: Moment) -> bool {
    match &condition.kind {
        ConditionKind::Timed(about, _) => *about == moment,
        ConditionKind::And(parts) => !parts.is_empty() && parts.iter().all(|part| is_only_about(part, moment)),
        ConditionKind::Forall(_, inner) => is_only_about(inner, moment),
        _ => false,
    }
}

fn happens_only_at(effect: &Effect, moment: Moment) -> bool {
    match &effect.kind {
        EffectKind::Timed(when, _) => *when == moment,
        EffectKind::And(parts) => !parts.is_empty() && parts.iter().all(|part| happens_only_at(part, moment)),
        EffectKind::Forall(_, inner) => happens_only_at(inner, moment),
        _ => false,
    }
}
