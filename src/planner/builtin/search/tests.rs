//! What holds for whole searches.

use std::collections::{HashMap, VecDeque};

use super::axiom::Axioms;
use super::example::{door, names, random};
use super::relaxed::{Costs, Relaxed};
use super::solve::{End, Event, Improvement, Settings, solve};
use super::successor::{apply, holds};
use super::task::{Axiom, Fact, OperatorId, Task};

/// Values of variables.
type Values = Vec<(usize, u32)>;

const SETTINGS: Settings = Settings { improvement: Improvement::Brief, memory: 1 << 26, work: u64::MAX };

fn plans(task: &Task, anytime: bool) -> (Vec<Vec<OperatorId>>, End) {
    let improvement = if anytime { Improvement::Unbounded } else { Improvement::Brief };
    let mut plans = Vec::new();
    let end = solve(task, Settings { improvement, ..SETTINGS }, &mut |event| {
        if let Event::Plan(plan) = event {
            plans.push(plan.to_vec());
        }
    });
    (plans, end)
}

/// The state after a plan; none where it cannot be carried out.
fn after(task: &Task, plan: &[OperatorId]) -> Option<Vec<Fact>> {
    let mut axioms = Axioms::new(task);
    let mut state = task.init.clone();
    axioms.derive(task, &mut state);
    for operator in plan {
        let operator = &task.operators[*operator as usize];
        if !holds(task, &state, &operator.condition) {
            return None;
        }
        apply(task, &mut axioms, operator, &mut state);
    }
    Some(state)
}

/// The cost of the cheapest plan, by looking at every state.
fn cheapest(task: &Task) -> Option<u64> {
    let mut axioms = Axioms::new(task);
    let mut best: HashMap<Vec<Fact>, u64> = HashMap::from([(task.init.clone(), 0)]);
    let mut queue = VecDeque::from([task.init.clone()]);
    while let Some(state) = queue.pop_front() {
        for operator in task.operators.iter().filter(|operator| holds(task, &state, &operator.condition)) {
            let mut next = state.clone();
            apply(task, &mut axioms, operator, &mut next);
            let cost = best[&state] + operator.cost as u64;
            if best.get(&next).is_none_or(|known| cost < *known) {
                best.insert(next.clone(), cost);
                queue.push_back(next);
            }
        }
    }
    best.iter().filter(|(state, _)| holds(task, state, &task.goal)).map(|(_, cost)| *cost).min()
}

#[test]
fn the_door_is_opened_before_one_goes_through() {
    let task = door();
    let (plans, end) = plans(&task, false);
    assert_eq!(end, End::Solved);
    assert_eq!(names(&task, &plans[0]), ["hall-store", "take", "store-hall", "open", "enter"]);
}

#[test]
fn a_task_without_a_plan_is_proven_to_have_none() {
    let mut task = door();
    task.operators.retain(|operator| operator.name != [1]);
    assert_eq!(plans(&task, false), (Vec::new(), End::Unsolvable));
}

#[test]
fn every_plan_reaches_the_goal_and_no_task_that_has_one_is_called_unsolvable() {
    let mut solved = 0;
    for task in (0..300).map(random) {
        let (plans, end) = plans(&task, false);
        assert_eq!(end == End::Unsolvable, cheapest(&task).is_none(), "{task:?}");
        for plan in &plans {
            assert!(after(&task, plan).is_some_and(|state| holds(&task, &state, &task.goal)), "{plan:?} {task:?}");
            solved += 1;
        }
    }
    assert!((50..290).contains(&solved), "{solved}");
}

#[test]
fn better_plans_are_said_until_the_cheapest() {
    for mut task in (0..100).map(random) {
        task.has_costs = true;
        let (plans, _) = plans(&task, true);
        let costs: Vec<u64> = plans.iter().map(|plan| task.cost(plan) as u64).collect();
        assert!(costs.is_sorted_by(|one, next| one > next), "{costs:?}");
        assert_eq!(costs.last().copied(), cheapest(&task), "{task:?}");
        assert!(plans.iter().all(|plan| after(&task, plan).is_some_and(|state| holds(&task, &state, &task.goal))));
    }
}

#[test]
fn one_task_has_one_plan() {
    for task in (0..40).map(random) {
        assert_eq!(plans(&task, false), plans(&task, false));
    }
}

#[test]
fn the_estimate_is_zero_exactly_at_goals() {
    for task in (0..100).map(random) {
        let mut relaxed = Relaxed::new(&task, Costs::Unit);
        let mut state = task.init.clone();
        let mut axioms = Axioms::new(&task);
        for operator in &task.operators {
            let is_goal = holds(&task, &state, &task.goal);
            assert_eq!(relaxed.estimate(&state, &task.goal).value == Some(0), is_goal);
            if holds(&task, &state, &operator.condition) {
                apply(&task, &mut axioms, operator, &mut state);
            }
        }
    }
}

#[test]
fn a_search_without_room_for_its_states_says_so() {
    // Twenty switches, and three lamps for which there are two fuses: any two are lit together, never all.
    let switches: Vec<(usize, u32)> = (0..20).map(|switch| (switch, 1)).collect();
    let mut operators: Vec<(&str, Values, Values)> = Vec::new();
    for switch in 0..20 {
        operators.push(("on", vec![(switch, 0)], vec![(switch, 1)]));
        operators.push(("off", vec![(switch, 1)], vec![(switch, 0)]));
    }
    for lamp in 20..23 {
        for fuses in 0..2 {
            operators.push(("light", vec![(lamp, 0), (23, fuses + 1)], vec![(lamp, 1), (23, fuses)]));
            operators.push(("dim", vec![(lamp, 1), (23, fuses)], vec![(lamp, 0), (23, fuses + 1)]));
        }
    }
    let borrowed: Vec<_> = operators.iter().map(|(name, pre, eff)| (*name, pre.as_slice(), eff.as_slice())).collect();
    let mut init = vec![0; 24];
    init[23] = 2;
    let goal: Vec<(usize, u32)> = switches.into_iter().chain((20..23).map(|lamp| (lamp, 1))).collect();
    let domains: Vec<u32> = (0..24).map(|variable| if variable == 23 { 3 } else { 2 }).collect();
    let task = super::example::task(&domains, &init, &goal, &borrowed);
    let mut states = 0;
    let end = solve(&task, Settings { memory: 1 << 20, ..SETTINGS }, &mut |event| {
        if let Event::States(count) = event {
            states = count;
        }
    });
    assert_eq!(end, End::Full);
    assert!(states > 1000, "{states}");
}

#[test]
fn derived_values_follow_the_layers_of_their_axioms() {
    // 0 and 1 are switches; 2 is true where 0 is on; 3 where 2 is false and 1 is on.
    let mut task = super::example::task(
        &[2, 2, 2, 2],
        &[1, 1, 0, 0],
        &[(3, 1)],
        &[("off", &[(0, 1)], &[(0, 0)]), ("dark", &[(1, 1)], &[(1, 0)])],
    );
    task.is_derived = vec![false, false, true, true];
    let offset = |variable: usize, value: u32| task.offsets[variable] + value;
    task.axioms = vec![
        Axiom { condition: vec![offset(0, 1)], fact: offset(2, 1), layer: 0 },
        Axiom { condition: vec![offset(1, 1), offset(2, 0)], fact: offset(3, 1), layer: 1 },
    ];
    task.relaxed = vec![(vec![task.offsets[0]], task.offsets[2])];
    let mut state = task.init.clone();
    Axioms::new(&task).derive(&task, &mut state);
    assert_eq!(state, [1, 3, 5, 6]);
    let (plans, end) = plans(&task, false);
    assert_eq!((names(&task, &plans[0]), end), (vec!["off".to_owned()], End::Solved));
}
