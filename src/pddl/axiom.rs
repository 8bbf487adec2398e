//! Derived predicates whose rules look at facts that actions change.
//!
//! Rules over facts that never change are settled before planning begins;
//! the others have to be derived anew in every state, which not every planner does.

use std::collections::HashSet;

use crate::formats::Span;
use crate::formats::pddl::ast::{Condition, ConditionKind, Domain, Effect, EffectKind};

/// The first place in a rule that asks for a fact which some action adds or deletes.
pub(super) fn first_changing(domain: &Domain) -> Option<Span> {
    let effects = domain.actions.iter().filter_map(|action| action.effect.as_ref());
    let effects = effects.chain(domain.durative_actions.iter().filter_map(|action| action.effect.as_ref()));
    let changed: HashSet<String> = effects.flat_map(changes).collect();
    domain.derived.iter().find_map(|rule| asks(&rule.condition, &changed))
}

/// The predicates that an effect touches, in lower case.
fn changes(effect: &Effect) -> Vec<String> {
    let (mut todo, mut found) = (vec![effect], Vec::new());
    while let Some(effect) = todo.pop() {
        match &effect.kind {
            EffectKind::Add(atom) | EffectKind::Delete(atom) => found.push(atom.name.as_str().to_lowercase()),
            EffectKind::And(parts) => todo.extend(parts),
            EffectKind::Forall(_, part) | EffectKind::When(_, part) | EffectKind::Timed(_, part) => todo.push(part),
            EffectKind::Assign(..) => {}
        }
    }
    found
}

/// Where a condition asks for one of these predicates.
fn asks(condition: &Condition, predicates: &HashSet<String>) -> Option<Span> {
    let mut todo = vec![condition];
    while let Some(condition) = todo.pop() {
        match &condition.kind {
            ConditionKind::Atom(atom) if predicates.contains(&atom.name.as_str().to_lowercase()) => {
                return Some(condition.place.0);
            }
            ConditionKind::Atom(_) | ConditionKind::Comparison(..) => {}
            ConditionKind::And(parts) | ConditionKind::Or(parts) | ConditionKind::Modal(_, _, parts) => {
                todo.extend(parts.iter().rev());
            }
            ConditionKind::Imply(left, right) => todo.extend([right.as_ref(), left.as_ref()]),
            ConditionKind::Not(part)
            | ConditionKind::Forall(_, part)
            | ConditionKind::Exists(_, part)
            | ConditionKind::Timed(_, part)
            | ConditionKind::Preference(_, part) => todo.push(part),
        }
    }
    None
}
