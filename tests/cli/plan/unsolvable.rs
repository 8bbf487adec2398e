//! Tasks with numbers or times that have no plan: what is proven ends with 11, and says what stands in the way.

use crate::lab::{Finished, Lab, assert_run};

fn planned(domain: &str, problem: &str) -> Finished {
    let lab = Lab::new();
    lab.write("d.pddl", domain);
    lab.write("p.pddl", problem);
    lab.rmem(&["plan", "--no-store", "--domain", "d.pddl", "--problem", "p.pddl"])
}

/// A robot whose battery is emptied by each drive, and is never charged.
const ROBOT: &str = "(define (domain robot) (:requirements :typing :numeric-fluents) (:types place)
    (:predicates (at ?p - place) (road ?a ?b - place)) (:functions (battery) (distance ?a ?b - place))
    (:action drive :parameters (?a ?b - place)
      :precondition (and (at ?a) (road ?a ?b) (>= (battery) (distance ?a ?b)))
      :effect (and (not (at ?a)) (at ?b) (decrease (battery) (distance ?a ?b)))))";

fn trip(battery: u32) -> String {
    format!(
        "(define (problem trip) (:domain robot) (:objects home shed field - place)
        (:init (at home) (road home shed) (road shed home) (road shed field) (= (battery) {battery})
          (= (distance home shed) 6) (= (distance shed home) 6) (= (distance shed field) 5)) (:goal (at field)))"
    )
}

#[test]
fn a_battery_below_what_every_way_needs_is_a_proof() {
    assert_run!(planned(ROBOT, &trip(11)), @r"
    (drive home shed)
    (drive shed field)
    ; cost = 2 (unit cost)
    ------- stderr -------
    [exit code: 0]
    ");
    // For each of the roads it is full enough, for both of them it is not.
    assert_run!(planned(ROBOT, &trip(10)), @r"
    ------- stderr -------
    error: builtin: proven: no plan exists: best first search space empty! problem proven unsolvable.
    why: each condition of the goal could be reached if nothing were ever undone; what actions delete, numbers or times stand in the way
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
    assert_run!(planned(ROBOT, &trip(5)), @r"
    ------- stderr -------
    error: builtin: proven: no plan exists: goal can be simplified to FALSE. No plan will solve it: (>= (battery) 6) can never hold: (battery) is always 5
    why: each condition of the goal could be reached if nothing were ever undone; what actions delete, numbers or times stand in the way
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
}

#[test]
fn a_number_that_never_gets_there_is_named() {
    let problem = trip(11).replace("(at field)))", "(and (at field) (> (battery) 20))))");
    assert_run!(planned(ROBOT, &problem), @r"
    ------- stderr -------
    error: builtin: proven: no plan exists: goal can be simplified to FALSE. No plan will solve it: (> (battery) 20) can never hold: (battery) is at most 11
    why: each condition of the goal could be reached if nothing were ever undone; what actions delete, numbers or times stand in the way
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
}

/// A guard has to be at the door while it is open: for five minutes, from the eighth on.
const GUARD: &str = "(define (domain guard) (:requirements :typing :durative-actions :timed-initial-literals)
    (:types place) (:predicates (at ?p - place) (road ?a ?b - place) (open ?p - place) (seen ?p - place) (tired))
    (:durative-action walk :parameters (?a ?b - place) :duration (= ?duration 4)
      :condition (and (at start (at ?a)) (over all (road ?a ?b)))
      :effect (and (at start (not (at ?a))) (at end (at ?b))))
    (:durative-action look :parameters (?p - place) :duration (= ?duration 3)
      :condition (and (over all (at ?p)) (over all (open ?p)))
      :effect (and (at start (tired)) (at end (seen ?p)))))";

fn round(init: &str, goal: &str) -> String {
    format!(
        "(define (problem round) (:domain guard) (:objects gate yard door - place)
        (:init (at gate) (road gate yard) (road yard door) {init}) (:goal {goal}))"
    )
}

#[test]
fn a_goal_that_no_order_of_starts_and_ends_reaches_is_a_proof() {
    assert_run!(planned(GUARD, &round("(open door)", "(and (seen door) (at door))")), @r"
    0.000: (walk gate yard) [4.000]
    4.001: (walk yard door) [4.000]
    8.002: (look door) [3.000]
    ; makespan = 11.002
    ------- stderr -------
    [exit code: 0]
    ");
    // The guard never comes back, whatever the time.
    assert_run!(planned(GUARD, &round("(open door)", "(and (seen door) (at gate))")), @r"
    ------- stderr -------
    error: builtin: proven: no plan exists: best first search space empty! problem proven unsolvable.
    why: each condition of the goal could be reached if nothing were ever undone; what actions delete, numbers or times stand in the way
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
    // The timed literals have an order.
    let swapped = "(at 3 (open gate)) (at 9 (not (open gate))) (at 20 (open door))";
    assert_run!(planned(GUARD, &round(swapped, "(and (seen door) (open gate))")), @r"
    ------- stderr -------
    error: builtin: proven: no plan exists: best first search space empty! problem proven unsolvable.
    why: each condition of the goal could be reached if nothing were ever undone; what actions delete, numbers or times stand in the way
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
}
