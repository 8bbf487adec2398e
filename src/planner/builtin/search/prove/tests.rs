//! Proofs, checked by hand and against searches through all states.

use std::collections::{HashMap, VecDeque};

use proptest::prelude::*;

use super::super::axiom::Axioms;
use super::super::example::{door, names, random, task};
use super::super::lazy::Step;
use super::super::successor::{apply, holds};
use super::super::task::{Axiom, Fact, OperatorId, Task};
use super::Prover;
use super::alive::{Alive, Known, alive};
use super::exhaust::Exhaust;

/// Work that suffices for each of these tasks.
const ENOUGH: u64 = 1 << 30;

fn known(task: &Task) -> Option<Alive> {
    match alive(task, ENOUGH) {
        Known::Alive(alive) => Some(alive),
        Known::Unsolvable => None,
        other => panic!("{other:?}"),
    }
}

/// The pairs of facts that are dead ends, as variables and values.
fn dead(task: &Task, alive: &Alive) -> Vec<[(usize, u32); 2]> {
    let value = |fact: Fact| (task.variable(fact), fact - task.offsets[task.variable(fact)]);
    let facts = task.facts() as Fact;
    let all = (0..facts).flat_map(|one| (one..facts).map(move |other| (one, other)));
    all.filter(|(one, other)| alive.dead.has(*one, *other)).map(|(one, other)| [value(one), value(other)]).collect()
}

#[test]
fn a_journey_that_needs_more_fuel_than_there_is_has_no_plan() {
    // From place 0 to place 3, each step burns a unit. In the relaxed task the last unit lasts for ever.
    let drive = |fuel: u32| {
        let steps = (0..3).flat_map(move |place| {
            (0..fuel).map(move |left| (vec![(0, place), (1, left + 1)], vec![(0, place + 1), (1, left)]))
        });
        let steps: Vec<_> = steps.collect();
        let steps: Vec<_> = steps.iter().map(|(pre, eff)| ("drive", pre.as_slice(), eff.as_slice())).collect();
        task(&[4, fuel + 1], &[0, fuel], &[(0, 3)], &steps)
    };
    assert!(known(&drive(2)).is_none());
    let enough = drive(3);
    let alive = known(&enough).unwrap();
    // Of the nine steps, one from each place is possible.
    assert_eq!(alive.operators.len(), 3);
    assert!(dead(&enough, &alive).is_empty());
}

#[test]
fn a_door_that_falls_shut_behind_one_without_a_key_is_a_dead_end() {
    // Variables: place (shop, hall, vault), key (no, yes). The vault opens with the key, and there is no way back to the shop.
    let trap = task(
        &[3, 2],
        &[0, 0],
        &[(0, 2)],
        &[("buy", &[(0, 0)], &[(1, 1)]), ("leave", &[(0, 0)], &[(0, 1)]), ("enter", &[(0, 1), (1, 1)], &[(0, 2)])],
    );
    let alive = known(&trap).unwrap();
    assert_eq!(dead(&trap, &alive), [[(0, 1), (1, 0)]]);
    assert_eq!(alive.operators, [0, 1, 2]);
    let mut search = Exhaust::new(&trap, Some(alive));
    assert_eq!(search.run(ENOUGH, 1 << 20), Step::Plan(vec![0, 1, 2]));
    // In the shop without and with the key, in the hall with it, in the vault.
    assert_eq!(search.states(), 4);
}

#[test]
fn operators_that_no_plan_has_are_left_out() {
    let mut task = door();
    // From the room there is a slide to the store: after the goal.
    task.operators.push(super::super::task::Operator { name: vec![0], ..task.operators[1].clone() });
    let last = task.operators.len() - 1;
    task.operators[last].condition = vec![2];
    let alive = known(&task).unwrap();
    assert_eq!(names(&task, &alive.operators), ["hall-store", "store-hall", "take", "open", "enter", "hall-store"]);
    // The room is empty while the door is shut.
    task.operators[last].condition = vec![2, 5];
    assert_eq!(known(&task).unwrap().operators, [0, 1, 2, 3, 4]);
}

/// Three tiles and a gap on a ring of four places: tiles slide into the gap, so that their order stays.
fn ring(goal: [u32; 3]) -> Task {
    // Variables: the place of each tile, and that of the gap.
    let mut steps = Vec::new();
    for tile in 0..3 {
        for from in 0..4 {
            for to in [(from + 1) % 4, (from + 3) % 4] {
                steps.push((vec![(tile, from), (3, to)], vec![(tile, to), (3, from)]));
            }
        }
    }
    let steps: Vec<_> = steps.iter().map(|(pre, eff)| ("slide", pre.as_slice(), eff.as_slice())).collect();
    let goal: Vec<(usize, u32)> = goal.into_iter().enumerate().collect();
    task(&[4; 4], &[0, 1, 2, 3], &goal, &steps)
}

#[test]
fn tiles_in_the_wrong_order_are_proven_by_all_their_states() {
    let swapped = ring([1, 0, 2]);
    // Each pair of tiles can be anywhere, so that pairs prove nothing.
    let alive = known(&swapped).unwrap();
    assert_eq!(alive.operators.len(), 24);
    let mut search = Exhaust::new(&swapped, Some(alive));
    assert_eq!(search.run(ENOUGH, 1 << 20), Step::Exhausted);
    // Of 24 orders, the turns of one: the gap is at any of four places, and three turns of the tiles go with it.
    assert_eq!((search.states(), search.waiting()), (12, 0));
    let turned = ring([1, 2, 3]);
    let Step::Plan(plan) = Prover::new(&turned).run(ENOUGH, 1 << 20) else { panic!() };
    assert_eq!(plan.len(), 3);
}

#[test]
fn a_proof_goes_on_where_it_was() {
    let swapped = ring([1, 0, 2]);
    let mut prover = Prover::new(&swapped);
    let mut slices = 1;
    // The pairs of facts do not fit into the first slices.
    while prover.run(50 << slices, 1 << 20) == Step::Spent {
        slices += 1;
    }
    assert!(slices > 3 && prover.states() == 12, "{slices} {}", prover.states());
    assert_eq!(Prover::new(&swapped).run(ENOUGH, 1 << 20), Step::Exhausted);
}

/// A random task, with a derived variable that a goal and an operator ask for.
fn derived(seed: u64) -> Task {
    let mut task = random(seed);
    let variable = task.len() as u32;
    let first = task.facts() as Fact;
    task.variables.extend([variable; 2]);
    task.predicates.extend([None; 2]);
    task.offsets.push(first + 2);
    task.is_derived.push(true);
    task.init.push(first);
    let condition = vec![task.offsets[0], task.offsets[1] + 1];
    task.axioms = vec![Axiom { condition, fact: first + 1, layer: 0 }];
    task.relaxed = vec![(vec![task.offsets[0] + 1], first)];
    task.relaxed_facts = task.facts();
    task.operators[0].condition.push(first + 1);
    task.operators[1].condition.push(first);
    task.goal.push(first + (seed % 2) as Fact);
    task
}

/// A shortest plan, by looking at every state.
fn blind(task: &Task) -> Option<Vec<OperatorId>> {
    let mut axioms = Axioms::new(task);
    let mut init = task.init.clone();
    axioms.derive(task, &mut init);
    let mut plans: HashMap<Vec<Fact>, Vec<OperatorId>> = HashMap::from([(init.clone(), Vec::new())]);
    let mut queue = VecDeque::from([init]);
    while let Some(state) = queue.pop_front() {
        if holds(task, &state, &task.goal) {
            return plans.remove(&state);
        }
        for (number, operator) in task.operators.iter().enumerate() {
            if holds(task, &state, &operator.condition) {
                let mut next = state.clone();
                apply(task, &mut axioms, operator, &mut next);
                if !plans.contains_key(&next) {
                    let plan = plans[&state].iter().copied().chain([number as OperatorId]).collect();
                    plans.insert(next.clone(), plan);
                    queue.push_back(next);
                }
            }
        }
    }
    None
}

/// Checks what is said of a task against all its states; says whether pairs alone proved that it has no plan.
fn agrees(task: &Task) -> Result<bool, TestCaseError> {
    let plan = blind(task);
    if plan.as_ref().is_some_and(Vec::is_empty) {
        return Ok(false);
    }
    let found = Prover::new(task).run(ENOUGH, 1 << 20);
    let known = known(task);
    match &plan {
        None => prop_assert_eq!(found, Step::Exhausted),
        Some(plan) => {
            let Step::Plan(found) = found else { return Err(TestCaseError::fail(format!("{found:?}, not {plan:?}"))) };
            prop_assert_eq!(found.len(), plan.len());
            let Some(alive) = &known else { return Err(TestCaseError::fail("unsolvable")) };
            prop_assert!(plan.iter().all(|operator| alive.operators.contains(operator)));
            let (mut axioms, mut state) = (Axioms::new(task), task.init.clone());
            for operator in plan {
                apply(task, &mut axioms, &task.operators[*operator as usize], &mut state);
                let pairs = state.iter().flat_map(|one| state.iter().map(move |other| (*one, *other)));
                prop_assert!(pairs.into_iter().all(|(one, other)| !alive.dead.has(one, other)));
            }
        }
    }
    Ok(known.is_none())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn only_what_has_no_plan_is_proven_to_have_none(seed in any::<u64>()) {
        agrees(&random(seed))?;
        agrees(&derived(seed))?;
    }
}

#[test]
fn pairs_prove_most_random_tasks_without_a_plan() {
    let tasks: Vec<Task> = (0..300).map(random).collect();
    let unsolvable = tasks.iter().filter(|task| blind(task).is_none()).count();
    let proven = tasks.iter().filter(|task| agrees(task).unwrap()).count();
    assert!(unsolvable > 50 && proven * 10 > unsolvable * 8, "{proven} of {unsolvable}");
}
