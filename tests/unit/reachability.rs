//! Why there is no plan: what can never hold, what would make it hold, what is missing.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use rmem::formats::Source;
use rmem::formats::pddl::Dialect;
use rmem::pddl::{Domain, Problem, Why, why};

fn explain(domain: &str, problem: &str) -> Why {
    let domain = Domain::read(&Source::new("d.pddl", domain), Dialect::default()).unwrap();
    let problem = Problem::read(&Source::new("p.pddl", problem), &domain, Dialect::default()).unwrap();
    why(&domain, &problem)
}

/// Explains a problem of a domain with these predicates and actions.
fn small(types: &str, body: &str, objects: &str, init: &str, goal: &str) -> Why {
    let domain = format!(
        "(define (domain d) (:requirements :adl :fluents :derived-predicates :durative-actions) (:types {types}) {body})"
    );
    let problem = format!("(define (problem p) (:domain d) (:objects {objects}) (:init {init}) (:goal {goal}))");
    explain(&domain, &problem)
}

/// The conditions that can never hold.
fn conditions(why: &Why) -> Vec<&str> {
    assert!(!why.is_unknown);
    why.obstacles.iter().map(|obstacle| obstacle.condition.as_str()).collect()
}

/// What each action that would make the n-th of these conditions hold lacks.
fn missing(why: &Why, place: usize) -> Vec<(String, String)> {
    let achievers = &why.obstacles[place].achievers;
    achievers.iter().map(|achiever| (achiever.action.clone(), achiever.missing.join(" "))).collect()
}

const BLOCKS: &str = "(:predicates (on ?x ?y - block) (clear ?x - block) (table ?x - block) (held ?x - block) (empty))
    (:action pick :parameters (?x - block) :precondition (and (clear ?x) (table ?x) (empty))
      :effect (and (held ?x) (not (clear ?x)) (not (table ?x)) (not (empty))))
    (:action stack :parameters (?x ?y - block) :precondition (and (held ?x) (clear ?y))
      :effect (and (on ?x ?y) (clear ?x) (empty) (not (held ?x)) (not (clear ?y))))";

#[test]
fn the_goal_is_followed_to_what_the_problem_never_said() {
    let why =
        small("block", BLOCKS, "a b c - block", "(clear a) (clear b) (table a) (table b)", "(and (on a b) (table c))");
    assert_eq!(conditions(&why)[..2], ["(on a b)", "(table c)"]);
    assert_eq!(why.goals, 2);
    assert_eq!(missing(&why, 0), [("(stack a b)".to_owned(), "(held a)".to_owned())]);
    assert_eq!(missing(&why, 1), []);
    assert_eq!(conditions(&why)[2..], ["(held a)", "(empty)", "(held ?x)"]);
    assert_eq!(missing(&why, 2), [("(pick a)".to_owned(), "(empty)".to_owned())]);
    assert_eq!(why.unfilled, ["empty", "held"]);
    let text = why.to_string();
    assert!(
        text.contains("(stack a b) would make it true, but needs (held a)")
            && text.contains("never true, in the initial state or by an action"),
        "{text}"
    );
}

#[test]
fn where_every_goal_is_reachable_alone_deletes_are_named() {
    let init = "(clear a) (clear b) (table a) (table b) (empty)";
    let why = small("block", BLOCKS, "a b - block", init, "(and (on a b) (on b a))");
    assert_eq!((why.goals, conditions(&why)), (0, vec![]));
    assert!(why.to_string().contains("delete"), "{why}");
}

#[test]
fn conditions_that_never_hold_for_the_same_objects_are_told_apart() {
    let body = "(:predicates (red ?x - o) (round ?x - o) (found))
        (:action find :parameters (?x - o) :precondition (and (red ?x) (round ?x)) :effect (found))";
    let why = small("o", body, "a b - o", "(red a) (round b)", "(found)");
    assert_eq!(missing(&why, 0), [("(find ?x)".to_owned(), String::new())]);
    assert!(why.to_string().contains("its preconditions never hold together"), "{why}");
}

#[test]
fn negations_hold_where_a_fact_is_missing_or_deleted() {
    let body = "(:predicates (dirty ?x - o) (locked ?x - o) (done ?x - o))
        (:action wipe :parameters (?x - o) :precondition (dirty ?x) :effect (not (dirty ?x)))
        (:action finish :parameters (?x - o) :precondition (and (not (dirty ?x)) (not (locked ?x))) :effect (done ?x))";
    assert_eq!(small("o", body, "a - o", "(dirty a)", "(done a)").goals, 0);
    let why = small("o", body, "a - o", "(dirty a) (locked a)", "(done a)");
    assert_eq!(missing(&why, 0), [("(finish a)".to_owned(), "(not (locked a))".to_owned())]);
    let why = small("o", body, "a - o", "(locked a)", "(not (locked a))");
    assert_eq!(conditions(&why), ["(not (locked a))"]);
}

#[test]
fn conditional_and_quantified_effects_count() {
    let body = "(:predicates (at ?x - o) (in ?x - o) (wet ?x - o) (rain))
        (:action pour :parameters () :effect (forall (?x - o) (when (and (at ?x) (rain)) (wet ?x))))
        (:action pray :parameters () :precondition (in a) :effect (rain))";
    let objects = body.replace("in a", "exists (?y - o) (in ?y)");
    assert_eq!(small("o", &objects, "a b - o", "(at a) (in b)", "(wet a)").goals, 0);
    let why = small("o", &objects, "a b - o", "(at a)", "(forall (?x - o) (wet ?x))");
    assert_eq!(why.goals, 1);
    let why = small("o", &objects, "a b - o", "(at a)", "(wet a)");
    assert_eq!(missing(&why, 0), [("(pour)".to_owned(), "(rain)".to_owned())]);
    assert_eq!(missing(&why, 1), [("(pray)".to_owned(), "(exists (?y - o) (in ?y))".to_owned())]);
}

#[test]
fn derived_predicates_are_followed_through_their_rules() {
    let body = "(:predicates (link ?x ?y - o) (way ?x ?y - o) (there ?x - o))
        (:derived (way ?x ?y - o) (or (link ?x ?y) (exists (?z - o) (and (link ?x ?z) (way ?z ?y)))))
        (:action go :parameters (?x ?y - o) :precondition (and (there ?x) (way ?x ?y)) :effect (there ?y))";
    assert_eq!(small("o", body, "a b c - o", "(there a) (link a b) (link b c)", "(there c)").goals, 0);
    let why = small("o", body, "a b c - o", "(there a) (link a b)", "(there c)");
    assert_eq!(missing(&why, 0), [("(go ?x c)".to_owned(), "(way ?x c)".to_owned())]);
}

#[test]
fn numbers_that_nothing_changes_are_compared() {
    let body = "(:predicates (in ?x - o)) (:functions (size ?x - o) (room))
        (:action put :parameters (?x - o) :precondition (<= (size ?x) (room)) :effect (in ?x))";
    let why = small("o", body, "a b - o", "(= (size a) 5) (= (size b) 1) (= (room) 3)", "(and (in a) (in b))");
    assert_eq!(conditions(&why), ["(in a)"]);
    assert_eq!(missing(&why, 0), [("(put a)".to_owned(), "(<= (size a) (room))".to_owned())]);
    let grows = format!("{body} (:action grow :parameters () :effect (increase (room) 1))");
    assert_eq!(small("o", &grows, "a - o", "(= (size a) 5) (= (room) 3)", "(in a)").goals, 0);
}

#[test]
fn a_type_without_objects_is_missing() {
    let body = "(:predicates (done)) (:action work :parameters (?r - robot) :effect (done))";
    let why = small("robot", body, "", "", "(done)");
    assert_eq!(missing(&why, 0), [("(work ?r)".to_owned(), "an object of type robot".to_owned())]);
}

#[test]
fn times_do_not_matter() {
    let body = "(:predicates (open) (in) (lit))
        (:durative-action enter :parameters () :duration (= ?duration 2)
          :condition (and (at start (open)) (over all (lit))) :effect (and (at end (in))))";
    assert_eq!(small("o", body, "", "(lit) (at 5 (open))", "(in)").goals, 0);
    assert_eq!(missing(&small("o", body, "", "(lit)", "(in)"), 0), [("(enter)".to_owned(), "(open)".to_owned())]);
}

/// The tasks of a folder of the fixtures, by name.
fn task(name: &str) -> Why {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/tasks").join(name);
    let read = |file: &str| fs::read_to_string(folder.join(file)).unwrap();
    explain(&read("domain.pddl"), &read("problem.pddl"))
}

#[test]
fn nothing_is_called_unreachable_where_there_is_a_plan() {
    for name in ["solvable", "goal-true", "adl-deletes", "numeric", "derived-static", "derived-dynamic", "durative"] {
        let why = task(name);
        assert_eq!((why.goals, why.is_unknown), (0, false), "{name}: {why}");
    }
    for name in ["goal-false", "unreachable"] {
        assert!(task(name).goals > 0, "{name}");
    }
}

#[test]
fn what_is_too_large_is_not_explained() {
    assert!(task("explosion").is_unknown);
}

#[test]
fn long_chains_are_followed_only_so_far() {
    let mut body = "(:predicates".to_owned();
    (0..50).for_each(|step| write!(body, " (s{step})").unwrap());
    body.push(')');
    (1..50).for_each(|step| {
        write!(body, "(:action a{step} :parameters () :precondition (s{}) :effect (s{step}))", step - 1).unwrap();
    });
    let why = small("o", &body, "", "", "(s49)");
    assert_eq!((why.goals, why.obstacles.len()), (1, 12));
}

/// What an action needs at its end or all the time may come true by its own start, or while it runs.
#[test]
fn the_start_of_an_action_may_give_what_its_end_needs() {
    let unreachable = |needs: &str, effects: &str, goal: &str| {
        let body = format!(
            "(:predicates (moving) (dark) (there) (lit))
            (:durative-action go :parameters () :duration (= ?duration 5)
              :condition (and {needs}) :effect (and {effects} (at end (there))))
            (:durative-action match :parameters () :duration (= ?duration 9)
              :condition (and (at start (not (lit))) (at end (there))) :effect (and (at start (lit)) (at end (not (lit)))))"
        );
        let why = small("", &body, "", "(dark)", goal);
        conditions(&why).iter().map(|condition| (*condition).to_owned()).collect::<Vec<_>>()
    };
    let none: [&str; 0] = [];
    assert_eq!(unreachable("(over all (moving))", "(at start (moving))", "(there)"), none);
    assert_eq!(unreachable("(at end (moving))", "(at start (moving))", "(there)"), none);
    assert_eq!(unreachable("(over all (not (dark)))", "(at start (not (dark)))", "(there)"), none);
    assert_eq!(unreachable("(over all (lit))", "", "(and (there) (not (lit)))"), none, "within another that needs it");
    assert_eq!(unreachable("(at start (moving))", "(at start (moving))", "(there)")[0], "(there)");
    assert_eq!(unreachable("(at start (moving))", "(at start (moving))", "(moving)")[0], "(moving)");
    assert_eq!(unreachable("(at end (moving))", "(at end (moving))", "(there)"), ["(there)", "(moving)"]);
}

/// A number that has no value keeps an action from being applied, in a condition or as its duration.
#[test]
fn numbers_without_a_value_are_named() {
    let body = |duration: &str, condition: &str| {
        format!(
            "(:predicates (there)) (:functions (speed) (way) (far))
            (:action jump :parameters () :precondition (> (far) 0) :effect (and))
            (:durative-action go :parameters () :duration {duration} :condition (and {condition})
              :effect (at end (there)))"
        )
    };
    let go = |duration: &str, condition: &str| {
        let why = small("", &body(duration, condition), "", "(= (speed) 0) (= (way) 5)", "(there)");
        if why.goals == 0 { Vec::new() } else { missing(&why, 0) }
    };
    let needs = |text: &str| vec![("(go)".to_owned(), text.to_owned())];
    assert_eq!(go("(= ?duration (/ (way) (speed)))", ""), needs("(= ?duration (/ (way) (speed))): a division by zero"));
    assert_eq!(go("(= ?duration (far))", ""), needs("(= ?duration (far)): (far) has no value"));
    assert_eq!(go("(= ?duration 1)", "(at start (> (far) 0))"), needs("(> (far) 0): (far) has no value"));
    assert_eq!(go("(= ?duration (way))", ""), []);
}

/// Between a start and an end at one moment nothing has to hold.
#[test]
fn what_takes_no_time_needs_nothing_over_all() {
    let goals = |duration: &str, length: &str| {
        let body = format!(
            "(:predicates (there) (lit)) (:functions (length))
            (:durative-action go :parameters () :duration {duration} :condition (over all (lit))
              :effect (at end (there)))"
        );
        small("", &body, "", &format!("(= (length) {length})"), "(there)").goals
    };
    assert_eq!(goals("(= ?duration 0)", "1"), 0);
    assert_eq!(goals("(<= ?duration 5)", "1"), 0);
    assert_eq!(goals("(= ?duration (length))", "0"), 0);
    assert_eq!(goals("(= ?duration (length))", "1"), 1);
    assert_eq!(goals("(and (>= ?duration 1) (<= ?duration 5))", "1"), 1);
}
