//! Action elimination (Nakhost and Müller 2010, "Action elimination and plan neighborhood graph search: two algorithms
//! for plan improvement"): an action is left out, with all that cannot be applied without it, where the goal is
//! reached all the same.

use super::axiom::Axioms;
use super::successor::{apply, holds, is_applicable};
use super::task::{Fact, OperatorId, Task};

/// Most operators that are applied to look for what can be left out.
const WORK: usize = 4_000_000;

/// Returns a plan without actions that it does not need.
pub(super) fn eliminate(task: &Task, init: &[Fact], plan: &[OperatorId]) -> Vec<OperatorId> {
    let mut axioms = Axioms::new(task);
    let (mut plan, mut place, mut work) = (plan.to_vec(), 0, 0);
    let mut start = init.to_vec();
    while place < plan.len() && work < WORK {
        work += plan.len() - place;
        match without(task, &mut axioms, &start, &plan[place..]) {
            Some(rest) => {
                plan.truncate(place);
                plan.extend(rest);
            }
            None => {
                apply(task, &mut axioms, &task.operators[plan[place] as usize], &mut start);
                place += 1;
            }
        }
    }
    plan
}

/// The plan without its first action and what depends on it; `None` where that reaches no goal, or costs as much.
fn without(task: &Task, axioms: &mut Axioms, start: &[Fact], plan: &[OperatorId]) -> Option<Vec<OperatorId>> {
    let (first, rest) = plan.split_first()?;
    let mut state = start.to_vec();
    let mut kept = Vec::new();
    let mut saved = task.operators[*first as usize].cost;
    for number in rest {
        let operator = &task.operators[*number as usize];
        if is_applicable(task, operator, &state) {
            apply(task, axioms, operator, &mut state);
            kept.push(*number);
        } else {
            saved += operator.cost;
        }
    }
    (saved >= 0.0 && holds(task, &state, &task.goal)).then_some(kept)
}

#[cfg(test)]
mod tests {
    use super::super::example::{door, names};
    use super::*;

    #[test]
    fn a_detour_is_left_out_with_the_way_back() {
        let task = door();
        // To the store and back before anything, and once more after the door is open.
        let plan = [0, 1, 0, 2, 1, 3, 0, 1, 4];
        let shorter = eliminate(&task, &task.init, &plan);
        assert_eq!(names(&task, &shorter), ["hall-store", "take", "store-hall", "open", "enter"]);
    }

    #[test]
    fn a_plan_without_detours_stays() {
        let task = door();
        assert_eq!(eliminate(&task, &task.init, &[0, 2, 1, 3, 4]), [0, 2, 1, 3, 4]);
    }
}
