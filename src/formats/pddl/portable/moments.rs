//! Which moments of a durative action a conditional effect is about.

use crate::formats::pddl::ast::{Condition, ConditionKind, Effect, EffectKind, Moment};

/// The moment that a condition and the effect under it are both about, and nothing else.
pub(crate) fn joint_moment(condition: &Condition, effect: &Effect) -> Option<Moment> {
    [Moment::Start, Moment::End]
        .into_iter()
        .find(|moment| is_only_about(condition, *moment) && happens_only_at(effect, *moment))
}

/// Whether a condition names a moment of a durative action.
pub(crate) fn names_moment(condition: &Condition) -> bool {
    match &condition.kind {
        ConditionKind::Timed(..) => true,
        ConditionKind::And(parts) | ConditionKind::Or(parts) => parts.iter().any(names_moment),
        ConditionKind::Imply(left, right) => names_moment(left) || names_moment(right),
        ConditionKind::Not(inner)
        | ConditionKind::Forall(_, inner)
        | ConditionKind::Exists(_, inner)
        | ConditionKind::Preference(_, inner) => names_moment(inner),
        ConditionKind::Atom(_) | ConditionKind::Comparison(..) | ConditionKind::Modal(..) => false,
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
