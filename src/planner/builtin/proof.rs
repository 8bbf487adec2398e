//! What an exhausted search of ferroplan's proves.

use ferroplan::types::{Domain, Effect, Formula, Problem};

/// Why an exhausted search proves nothing: ferroplan's estimate of what is still
/// reachable decides which states it drops, and only for these tasks is it known to err
/// on the safe side.
///
/// Takes the task as it was read, before ferroplan compiles anything away.
pub(super) fn doubt(domain: &Domain, problem: &Problem) -> Option<&'static str> {
    if !domain.durative_actions.is_empty() || !problem.til.is_empty() {
        return Some("times");
    }
    if !domain.constraints.is_empty() || !problem.constraints.is_empty() || ferroplan::pddl3::has_preferences(problem) {
        return Some("preferences or constraints");
    }
    if !domain.derived.is_empty() {
        return Some("derived predicates");
    }
    if domain.actions.iter().any(|action| is_conditional(&action.effect)) {
        return Some("conditional effects");
    }
    let conditions = domain.actions.iter().map(|action| &action.precond).chain([&problem.goal]);
    conditions.into_iter().any(is_numeric).then_some("numeric conditions")
}

fn is_conditional(effect: &Effect) -> bool {
    match effect {
        Effect::When(..) => true,
        Effect::And(parts) => parts.iter().any(is_conditional),
        Effect::Forall(_, inner) => is_conditional(inner),
        _ => false,
    }
}

fn is_numeric(formula: &Formula) -> bool {
    match formula {
        Formula::Comp(..) => true,
        Formula::And(parts) | Formula::Or(parts) => parts.iter().any(is_numeric),
        Formula::Not(inner) | Formula::Forall(_, inner) | Formula::Exists(_, inner) | Formula::Pref(_, inner) => {
            is_numeric(inner)
        }
        _ => false,
    }
}
