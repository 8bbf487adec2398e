//! validate.

use serde_json::{Value, json};

use crate::gen_problem::problem;
use crate::lab::{Lab, assert_run};

#[test]
fn validate_accepts_a_plan_or_names_the_step_that_cannot_be_applied() {
    let lab = Lab::new();
    lab.write("p.pddl", &problem(&lab));
    let domain = "domains/blocksworld/domain.pddl";
    assert_run!(lab.rmem(&["validate", domain]), @r"
    domain blocksworld is valid
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["validate", domain, "p.pddl"]), @r"
    problem blocksworld-generated is valid
    ------- stderr -------
    [exit code: 0]
    ");
    let found = lab.rmem(&["plan", "-d", domain, "-p", "p.pddl", "--no-store"]).success();
    lab.write("good.plan", &found);
    assert_run!(lab.rmem(&["validate", domain, "p.pddl", "good.plan"]), @r"
    the plan is valid, value 5
    ------- stderr -------
    [exit code: 0]
    ");
    let mut lines: Vec<&str> = found.lines().filter(|line| line.starts_with('(')).collect();
    lines.remove(0);
    lab.write("bad.plan", &lines.join("\n"));
    assert_run!(lab.rmem(&["validate", domain, "p.pddl", "bad.plan"]), @r"
    the plan is invalid: step 1: (unstack D A) is not applicable: (hand-empty) is false
      (hand-empty): false in the initial state
        (putdown B) would make it true, and is applicable there
        (stack B C) would make it true, and is applicable there
    ------- stderr -------
    [exit code: 1]
    ");
    lab.write("cut.plan", "(pickup A");
    assert_run!(lab.rmem(&["validate", domain, "p.pddl", "cut.plan"]), @r"
    ------- stderr -------
    error: cut.plan:1:10: expected `)`, found the end of the text
      |
    1 | (pickup A
      |          ^
    [exit code: 3]
    ");
}

#[test]
fn a_trace_says_what_each_step_makes_true_and_false() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :typing :fluents) (:types place)
         (:predicates (at ?p - place)) (:functions (walked))
         (:action go :parameters (?a ?b - place) :precondition (at ?a)
           :effect (and (not (at ?a)) (at ?b) (increase (walked) 3.3))))",
    );
    lab.write(
        "p.pddl",
        "(define (problem p) (:domain d) (:objects a b c - place) (:init (at a) (= (walked) 5.3)) (:goal (at c))
         (:metric minimize (walked)))",
    );
    lab.write("good.txt", "(go a b)\n(go b c)\n");
    lab.write("bad.txt", "(go a b)\n(go a c)\n");
    assert_run!(lab.rmem(&["validate", "d.pddl", "p.pddl", "good.txt", "bad.txt", "-v"]), @r"
    1: (go a b)
      - (at a)
      + (at b)
      = (walked) from 5.3 to 8.6
    2: (go b c)
      - (at b)
      + (at c)
      = (walked) from 8.6 to 11.9
    good.txt: the plan is valid, value 11.9
    1: (go a b)
      - (at a)
      + (at b)
      = (walked) from 5.3 to 8.6
    bad.txt: the plan is invalid: step 2: (go a c) is not applicable: (at a) is false
      (at a): undone by step 1, (go a b)
        (go b a) would make it true, and is applicable there
    ------- stderr -------
    [exit code: 1]
    ");
    let report = crate::plan::parsed(
        &lab.rmem(&["validate", "d.pddl", "p.pddl", "good.txt", "-v", "--format", "json"]).success(),
    );
    let report = &report[0];
    assert_eq!((&report["value"], &report["makespan"]), (&json!(11.9), &Value::Null));
    assert_eq!(
        report["trace"][1],
        json!({"time": 2, "events": ["(go b c)"], "true": ["(at c)"], "false": ["(at b)"],
            "values": [{"fluent": "(walked)", "before": 8.6, "after": 11.9}]})
    );
    let plain =
        crate::plan::parsed(&lab.rmem(&["validate", "d.pddl", "p.pddl", "good.txt", "--format", "json"]).success());
    assert!(plain[0].get("trace").is_none(), "{plain}");
    // One shape, whatever is checked.
    let all = |words: &[&str]| {
        let run = lab.rmem(&[&["validate", "d.pddl"], words, &["--format", "json"]].concat());
        crate::plan::parsed(&run.stdout).as_array().unwrap().clone()
    };
    let of = |report: &Value, keys: &[&str]| keys.iter().map(|key| report[*key].clone()).collect::<Vec<_>>();
    assert_eq!(all(&[])[0], json!({"domain": "d", "valid": true}));
    assert_eq!(all(&["p.pddl"])[0], json!({"domain": "d", "problem": "p", "valid": true}));
    let both = all(&["p.pddl", "good.txt", "bad.txt"]);
    assert_eq!(of(&both[0], &["plan", "valid", "steps"]), [json!("good.txt"), json!(true), json!(2)]);
    assert_eq!(of(&both[1], &["plan", "valid", "step"]), [json!("bad.txt"), json!(false), json!(2)]);
    // Durative actions happen at two moments.
    lab.write(
        "t.pddl",
        "(define (domain t) (:requirements :durative-actions) (:predicates (dark) (light))
         (:durative-action burn :parameters () :duration (= ?duration 5) :condition (at start (dark))
           :effect (and (at start (light)) (at end (not (light))) (at end (not (dark))))))",
    );
    lab.write("q.pddl", "(define (problem q) (:domain t) (:init (dark)) (:goal (not (dark))))");
    lab.write("t.txt", "0.5: (burn) [5]\n");
    assert_run!(lab.rmem(&["validate", "t.pddl", "q.pddl", "t.txt", "-v"]), @r"
    0.500: (burn) starts
      + (light)
    5.500: (burn) ends
      - (dark)
      - (light)
    the plan is valid, makespan 5.5
    ------- stderr -------
    [exit code: 0]
    ");
}
