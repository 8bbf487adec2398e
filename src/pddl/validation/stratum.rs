//! What rules look at, and the order in which they can be completed.

use std::collections::{HashMap, HashSet};

use super::error::EvaluationError;
use crate::pddl::model::{Arg, Formula, Number, Rule};

/// How many nodes a condition has.
pub(super) fn size(formula: &Formula) -> usize {
    1 + match formula {
        Formula::And(parts) | Formula::Or(parts) => parts.iter().map(size).sum(),
        Formula::Imply(left, right) => size(left) + size(right),
        Formula::Not(inner)
        | Formula::Forall(_, inner)
        | Formula::Exists(_, inner)
        | Formula::Timed(_, inner)
        | Formula::Preference(_, inner) => size(inner),
        _ => 0,
    }
}

/// Whether a condition looks at numbers.
pub(super) fn compares(formula: &Formula) -> bool {
    match formula {
        Formula::Compare(..) => true,
        Formula::And(parts) | Formula::Or(parts) => parts.iter().any(compares),
        Formula::Imply(left, right) => compares(left) || compares(right),
        Formula::Not(inner)
        | Formula::Forall(_, inner)
        | Formula::Exists(_, inner)
        | Formula::Timed(_, inner)
        | Formula::Preference(_, inner) => compares(inner),
        Formula::Fact(_) | Formula::Same(..) | Formula::Modal(..) => false,
    }
}

/// Calls `visit` with each predicate and whether it stands under an odd number of negations.
pub(in crate::pddl) fn predicates(formula: &Formula, visit: &mut dyn FnMut(u32, bool)) {
    walk(formula, false, visit);
}

fn walk(formula: &Formula, negated: bool, visit: &mut dyn FnMut(u32, bool)) {
    match formula {
        Formula::Fact(fact) => visit(fact.predicate, negated),
        Formula::Not(inner) => walk(inner, !negated, visit),
        Formula::And(parts) | Formula::Or(parts) => parts.iter().for_each(|part| walk(part, negated, visit)),
        Formula::Imply(left, right) => {
            walk(left, !negated, visit);
            walk(right, negated, visit);
        }
        Formula::Forall(_, inner)
        | Formula::Exists(_, inner)
        | Formula::Timed(_, inner)
        | Formula::Preference(_, inner) => walk(inner, negated, visit),
        Formula::Same(..) | Formula::Compare(..) | Formula::Modal(..) => {}
    }
}

/// The slots below `limit` that a condition mentions.
pub(in crate::pddl) fn free_slots(formula: &Formula, limit: u32, slots: &mut Vec<u32>) {
    let mut note = |argument: &Arg| {
        if let Arg::Slot(slot) = argument
            && *slot < limit
            && !slots.contains(slot)
        {
            slots.push(*slot);
        }
    };
    match formula {
        Formula::Fact(fact) => fact.arguments.iter().for_each(note),
        Formula::Same(left, right) => [left, right].into_iter().for_each(note),
        Formula::Compare(_, left, right) => {
            number_slots(left, &mut note);
            number_slots(right, &mut note);
        }
        Formula::And(parts) | Formula::Or(parts) => parts.iter().for_each(|part| free_slots(part, limit, slots)),
        Formula::Imply(left, right) => {
            free_slots(left, limit, slots);
            free_slots(right, limit, slots);
        }
        Formula::Not(inner)
        | Formula::Forall(_, inner)
        | Formula::Exists(_, inner)
        | Formula::Timed(_, inner)
        | Formula::Preference(_, inner) => free_slots(inner, limit, slots),
        Formula::Modal(..) => {}
    }
}

fn number_slots(number: &Number, note: &mut dyn FnMut(&Arg)) {
    match number {
        Number::Fluent(fluent) => fluent.arguments.iter().for_each(note),
        Number::Operation(_, operands) => operands.iter().for_each(|operand| number_slots(operand, note)),
        _ => {}
    }
}

/// The first rule whose predicate depends on a negation of itself, so that the rules have no least model.
pub(in crate::pddl) fn negative_cycle(rules: &[Rule]) -> Option<usize> {
    let components = components(rules);
    rules.iter().position(|rule| {
        let mut found = false;
        predicates(&rule.condition, &mut |predicate, negated| {
            found |= negated && components.get(&predicate) == components.get(&rule.predicate);
        });
        found
    })
}

/// The rules in the order in which they can be completed; those whose predicates depend on each other are together.
pub(super) fn strata(rules: &[Rule]) -> Result<Vec<Vec<&Rule>>, EvaluationError> {
    if negative_cycle(rules).is_some() {
        let reason = "a derived predicate depends on its own absence";
        return Err(EvaluationError::Unchecked(reason.to_owned()));
    }
    let components = components(rules);
    let count = components.values().max().map_or(0, |last| last + 1);
    let mut strata: Vec<Vec<&Rule>> = vec![Vec::new(); count];
    for rule in rules {
        if let Some(stratum) = components.get(&rule.predicate).and_then(|number| strata.get_mut(*number)) {
            stratum.push(rule);
        }
    }
    Ok(strata)
}

/// The derived predicates, those that depend on each other with the same number, and what they depend on with lower ones.
fn components(rules: &[Rule]) -> HashMap<u32, usize> {
    let mut uses: HashMap<u32, Vec<u32>> = rules.iter().map(|rule| (rule.predicate, Vec::new())).collect();
    let mut used_by = uses.clone();
    for rule in rules {
        predicates(&rule.condition, &mut |predicate, _| {
            if let Some(users) = used_by.get_mut(&predicate) {
                users.push(rule.predicate);
                uses.entry(rule.predicate).or_default().push(predicate);
            }
        });
    }
    // Two searches in depth, the second against the direction of the first (Sharir, 1981).
    let users: Vec<u32> = finished(rules.iter().map(|rule| rule.predicate), &used_by).concat();
    let components = finished(users.into_iter().rev(), &uses);
    let numbered = components.into_iter().enumerate();
    numbered.flat_map(|(number, predicates)| predicates.into_iter().map(move |predicate| (predicate, number))).collect()
}

/// What a search in depth finishes, in that order, for each start that was not met before.
fn finished(starts: impl Iterator<Item = u32>, edges: &HashMap<u32, Vec<u32>>) -> Vec<Vec<u32>> {
    let (mut seen, mut all) = (HashSet::new(), Vec::new());
    for start in starts {
        let (mut finished, mut path) = (Vec::new(), Vec::new());
        if seen.insert(start) {
            path.push((start, 0));
        }
        while let Some((node, place)) = path.last_mut() {
            match edges.get(node).and_then(|next| next.get(*place)) {
                Some(next) => {
                    *place += 1;
                    if seen.insert(*next) {
                        path.push((*next, 0));
                    }
                }
                None => {
                    finished.push(*node);
                    path.pop();
                }
            }
        }
        if !finished.is_empty() {
            all.push(finished);
        }
    }
    all
}
