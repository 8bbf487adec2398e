//! What rules look at, and the order in which they can be completed.

use std::collections::HashMap;

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
    let mut uses: HashMap<u32, Vec<(u32, bool)>> = HashMap::new();
    for rule in rules {
        let used = uses.entry(rule.predicate).or_default();
        predicates(&rule.condition, &mut |predicate, negated| {
            if !used.contains(&(predicate, negated)) {
                used.push((predicate, negated));
            }
        });
    }
    let reaches = |from: u32, to: u32| {
        let (mut seen, mut todo) = (vec![from], vec![from]);
        while let Some(predicate) = todo.pop() {
            if predicate == to {
                return true;
            }
            for (next, _) in uses.get(&predicate).into_iter().flatten() {
                if uses.contains_key(next) && !seen.contains(next) {
                    seen.push(*next);
                    todo.push(*next);
                }
            }
        }
        false
    };
    rules.iter().position(|rule| {
        let mut found = false;
        predicates(&rule.condition, &mut |predicate, negated| {
            found |= negated && uses.contains_key(&predicate) && reaches(predicate, rule.predicate);
        });
        found
    })
}

/// The rules in the order in which they can be completed.
pub(super) fn strata<'r>(rules: &'r [Rule], derived: &[u32]) -> Result<Vec<Vec<&'r Rule>>, EvaluationError> {
    let mut levels: HashMap<u32, usize> = derived.iter().map(|predicate| (*predicate, 0)).collect();
    let bound = levels.len();
    loop {
        let mut changed = false;
        for rule in rules {
            let mut level = levels.get(&rule.predicate).copied().unwrap_or_default();
            let before = level;
            predicates(&rule.condition, &mut |predicate, negated| {
                if let Some(below) = levels.get(&predicate) {
                    level = level.max(below + usize::from(negated));
                }
            });
            if level > bound {
                let reason = "a derived predicate depends on its own absence";
                return Err(EvaluationError::Unchecked(reason.to_owned()));
            }
            changed |= level != before;
            levels.insert(rule.predicate, level);
        }
        if !changed {
            break;
        }
    }
    let mut strata: Vec<Vec<&Rule>> = vec![Vec::new(); bound + 1];
    for rule in rules {
        if let Some(stratum) = levels.get(&rule.predicate).and_then(|level| strata.get_mut(*level)) {
            stratum.push(rule);
        }
    }
    Ok(strata)
}
