//! What the built-in planner gives out holds by the rules of the validator.

use crate::lab::{Finished, Lab, assert_run};

fn planned(lab: &Lab, domain: &str, problem: &str) -> Finished {
    lab.write("d.pddl", domain);
    lab.write("p.pddl", problem);
    lab.rmem(&["plan", "--no-store", "--domain", "d.pddl", "--problem", "p.pddl"])
}

#[test]
fn what_the_start_takes_away_is_not_there_later() {
    let domain = "(define (domain d) (:requirements :adl :durative-actions) (:predicates (lit ?l) (on ?l) (seen))
        (:durative-action swap :parameters (?l) :duration (= ?duration 2)
          :condition (and (at start (on ?l)) (over all (exists (?o) (on ?o))))
          :effect (and (at start (not (on ?l))) (at end (lit ?l)))))";
    let problem = "(define (problem p) (:domain d) (:objects a b) (:init (on a) (on b)) (:goal (lit a)))";
    assert_run!(planned(&Lab::new(), domain, problem), @r"
    0.000: (swap a) [2.000]
    ; makespan = 2
    ------- stderr -------
    [exit code: 0]
    ");
    let both = problem.replace("(:goal (lit a))", "(:goal (and (lit a) (lit b)))");
    assert_run!(planned(&Lab::new(), domain, &both), @r"
    ------- stderr -------
    error: builtin: proven: no plan exists: best first search space empty! problem proven unsolvable.
    why: each condition of the goal could be reached if nothing were ever undone; what actions delete, numbers or times stand in the way
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
}

#[test]
fn a_plan_that_does_not_hold_is_none() {
    // What is brought and taken away at once is there.
    let domain = "(define (domain d) (:requirements :adl :durative-actions) (:predicates (z))
        (:durative-action t :parameters () :duration (= ?duration 1) :effect (and (at end (z)) (at end (not (z))))))";
    let problem = "(define (problem p) (:domain d) (:init (z)) (:goal (not (z))))";
    assert_run!(planned(&Lab::new(), domain, problem), @r"
    ------- stderr -------
    error: builtin: proven: no plan exists: goal can be simplified to FALSE. No plan will solve it
    why: each condition of the goal could be reached if nothing were ever undone; what actions delete, numbers or times stand in the way
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
}

#[test]
fn a_duration_that_nothing_suits_is_none() {
    let domain = "(define (domain d) (:requirements :durative-actions :duration-inequalities) (:predicates (z) (y))
        (:durative-action short :parameters () :duration (and (>= ?duration 4) (<= ?duration 3)) :effect (at end (z)))
        (:durative-action first :parameters () :duration (= ?duration 1) :effect (at end (y)))
        (:durative-action long :parameters () :duration (= ?duration 9) :condition (at start (y)) :effect (at end (z))))";
    let problem = "(define (problem p) (:domain d) (:init) (:goal (z)))";
    assert_run!(planned(&Lab::new(), domain, problem), @r"
    0.000: (first) [1.000]
    1.001: (long) [9.000]
    ; makespan = 10.001
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn a_number_that_is_set_and_raised_at_once_is_not_for_a_plan() {
    let domain = "(define (domain d) (:requirements :adl :fluents) (:predicates (z) (q)) (:functions (g))
        (:action both :parameters () :effect (and (z) (increase (g) 1) (assign (g) 5)))
        (:action first :parameters () :effect (q))
        (:action second :parameters () :precondition (q) :effect (z)))";
    let problem = "(define (problem p) (:domain d) (:init (= (g) 0)) (:goal (z)))";
    assert_run!(planned(&Lab::new(), domain, problem), @r"
    (first)
    (second)
    ; cost = 2 (unit cost)
    ------- stderr -------
    [exit code: 0]
    ");
}
