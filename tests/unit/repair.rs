//! What would mend a plan that breaks.

use rmem::formats::Source;
use rmem::formats::pddl::Dialect;
use rmem::formats::plan::read_plan;
use rmem::pddl::{Domain, Problem, Step, repair};

/// What is printed about a plan, a repair after the other.
fn advice(domain: &str, problem: &str, plan: &str) -> String {
    let domain = Domain::read(&Source::new("d.pddl", domain), Dialect::default()).expect("a domain");
    let problem = Problem::read(&Source::new("p.pddl", problem), &domain, Dialect::default()).expect("a problem");
    let plan = read_plan(&Source::new("plan", plan)).expect("a plan");
    let steps: Vec<Step> = plan.actions.into_iter().map(Step::from).collect();
    repair(&domain, &problem, &steps).iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

const ROBOT: &str = "(define (domain robot) (:requirements :strips :typing) (:types place thing)
    (:predicates (at ?p - place) (free) (holds ?t - thing) (in ?t - thing ?p - place) (road ?p ?q - place) (key))
    (:action go :parameters (?p ?q - place) :precondition (and (at ?p) (road ?p ?q)) :effect (and (at ?q) (not (at ?p))))
    (:action jump :parameters (?q - place) :precondition (key) :effect (at ?q))
    (:action pick :parameters (?t - thing ?p - place) :precondition (and (at ?p) (in ?t ?p) (free))
      :effect (and (holds ?t) (not (free)) (not (in ?t ?p))))
    (:action drop :parameters (?t - thing ?p - place) :precondition (and (at ?p) (holds ?t))
      :effect (and (free) (in ?t ?p) (not (holds ?t)))))";
const ROOMS: &str = "(define (problem rooms) (:domain robot) (:objects a b c - place cup - thing)
    (:init (at a) (free) (in cup a) (road a b) (road b a) (road b c)) (:goal (in cup c)))";

#[test]
fn what_undid_a_condition_and_what_would_bring_it_back_are_named() {
    let printed = advice(ROBOT, ROOMS, "(pick cup a)\n(go a b)\n(DROP CUP A)\n");
    assert_eq!(
        printed,
        "(at a): undone by step 2, (go a b)\n  \
           (go b a) would make it true, and is applicable there\n  \
           (jump a) would make it true, but needs (key)"
    );
}

#[test]
fn what_no_action_makes_so_has_to_be_in_the_initial_state() {
    let printed = advice(ROBOT, ROOMS, "(pick cup a)\n(go a c)\n");
    assert_eq!(
        printed,
        "(road a c): false in the initial state\n  no action makes it true; it has to hold in the initial state"
    );
}

#[test]
fn a_goal_that_is_missed_is_looked_into_as_well() {
    let printed = advice(ROBOT, ROOMS, "(pick cup a)\n(go a b)\n(go b c)\n");
    assert_eq!(
        printed,
        "(in cup c): false in the initial state\n  (drop cup c) would make it true, and is applicable there"
    );
    let printed = advice(ROBOT, ROOMS, "(pick cup a)\n");
    assert_eq!(printed, "(in cup c): false in the initial state\n  (drop cup c) would make it true, but needs (at c)");
}

#[test]
fn what_has_to_become_false_is_told_with_what_made_it_true() {
    let domain = "(define (domain d) (:requirements :adl) (:predicates (wet ?x) (done ?x))
        (:action rain :effect (forall (?x) (wet ?x)))
        (:action dry :parameters (?x) :precondition (wet ?x) :effect (not (wet ?x)))
        (:action paint :parameters (?x) :precondition (not (wet ?x)) :effect (done ?x)))";
    let problem = "(define (problem p) (:domain d) (:objects a b) (:init) (:goal (done a)))";
    assert_eq!(
        advice(domain, problem, "(rain)\n(dry b)\n(paint a)\n"),
        "(not (wet a)): undone by step 1, (rain)\n  (dry a) would make it true, and is applicable there"
    );
}

#[test]
fn numbers_are_told_with_what_changes_them() {
    let domain = "(define (domain d) (:requirements :fluents) (:predicates (at ?x) (done)) (:functions (fuel) (need ?x))
        (:action fill :parameters (?x) :precondition (at ?x) :effect (increase (fuel) 5))
        (:action fly :parameters (?x) :precondition (>= (fuel) (need ?x)) :effect (and (done) (decrease (fuel) (need ?x)))))";
    let problem = "(define (problem p) (:domain d) (:objects a b)
        (:init (at b) (= (fuel) 3) (= (need a) 4) (= (need b) 1)) (:goal (done)))";
    assert_eq!(
        advice(domain, problem, "(fly b)\n(fly a)\n"),
        "(>= (fuel) (need a)): (fuel) is 2, (need a) is 4\n  \
           (fill b) would change that, and is applicable there"
    );
}

#[test]
fn invariants_and_timed_literals_are_told() {
    let domain =
        "(define (domain d) (:requirements :durative-actions :timed-initial-literals) (:predicates (lit) (done))
        (:durative-action light :parameters () :duration (= ?duration 3)
          :effect (and (at start (lit)) (at end (not (lit)))))
        (:durative-action work :parameters () :duration (= ?duration 2) :condition (over all (lit))
          :effect (at end (done))))";
    let problem = |init: &str| format!("(define (problem p) (:domain d) (:init {init}) (:goal (done)))");
    assert_eq!(
        advice(domain, &problem(""), "0: (light) [3]\n2: (work) [2]\n"),
        "(lit): undone by step 1, (light)\n  (light) would make it true, and is applicable there"
    );
    assert_eq!(
        advice(domain, &problem("(lit) (at 1 (not (lit)))"), "0: (work) [2]\n"),
        "(lit): undone by a timed initial literal\n  (light) would make it true, and is applicable there"
    );
}

#[test]
fn each_part_of_a_disjunction_is_a_way_out() {
    let domain = "(define (domain d) (:requirements :adl) (:predicates (p) (q ?x) (done))
        (:action make :parameters (?x) :effect (q ?x))
        (:action go :precondition (or (p) (exists (?x) (q ?x))) :effect (done)))";
    let problem = "(define (problem p) (:domain d) (:objects a) (:init) (:goal (done)))";
    assert_eq!(
        advice(domain, problem, "(go)\n"),
        "(p): false in the initial state\n  no action makes it true; it has to hold in the initial state\n\
         (q ?): depends on the object\n  (make a) would make it true, and is applicable there"
    );
}

#[test]
fn what_is_not_a_false_condition_has_no_repair() {
    assert_eq!(advice(ROBOT, ROOMS, "(fly a)\n"), "");
    assert_eq!(advice(ROBOT, ROOMS, "(pick cup a)\n(go a b)\n(go b c)\n(drop cup c)\n"), "");
}
