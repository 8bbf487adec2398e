//! What ferroplan does not have to be asked: it takes a condition over all that the action's own start makes true for one
//! that has to hold before, and finds no plan. Its plans are judged with the condition.

use crate::formats::Source;
use crate::formats::pddl::ast::{Atom, Condition, ConditionKind, DurativeAction, Effect, EffectKind, Moment};
use crate::formats::pddl::{Dialect, read_domain};

/// The text of a domain without such conditions; `None` where it has none, or cannot be read.
pub(in crate::planner::builtin) fn without_own(domain: &str) -> Option<String> {
    let mut tree = read_domain(&Source::new("domain", domain), Dialect::default()).ok()?;
    let mut is_changed = false;
    for action in &mut tree.durative_actions {
        is_changed |= leave_out(action);
    }
    is_changed.then(|| tree.to_string())
}

fn leave_out(action: &mut DurativeAction) -> bool {
    let mut brought = Vec::new();
    action.effect.iter().for_each(|effect| starts(effect, false, &mut brought));
    let mut is_changed = false;
    if !brought.is_empty() {
        action.condition.iter_mut().for_each(|condition| is_changed |= drop_from(condition, false, &brought));
    }
    is_changed
}

/// Adds the atoms that an effect makes true at the start.
fn starts(effect: &Effect, is_start: bool, brought: &mut Vec<Atom>) {
    match &effect.kind {
        EffectKind::And(parts) => parts.iter().for_each(|part| starts(part, is_start, brought)),
        EffectKind::Timed(moment, inner) => starts(inner, *moment == Moment::Start, brought),
        EffectKind::Add(atom) if is_start => brought.push(atom.clone()),
        _ => {}
    }
}

/// Leaves out what is asked over all and brought; says whether there was any.
fn drop_from(condition: &mut Condition, is_over_all: bool, brought: &[Atom]) -> bool {
    match &mut condition.kind {
        ConditionKind::And(parts) => {
            let mut is_changed = false;
            parts.iter_mut().for_each(|part| is_changed |= drop_from(part, is_over_all, brought));
            is_changed
        }
        ConditionKind::Timed(moment, inner) => drop_from(inner, *moment == Moment::All, brought),
        ConditionKind::Atom(atom) if is_over_all && brought.contains(atom) => {
            condition.kind = ConditionKind::And(Vec::new());
            true
        }
        _ => false,
    }
}
