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
fn of_several_plans_one_that_cannot_be_read_leaves_the_others_checked() {
    let lab = Lab::new();
    lab.write("p.pddl", &problem(&lab));
    let domain = "domains/blocksworld/domain.pddl";
    lab.write("broken.plan", "(a\n");
    lab.write("good.plan", &lab.rmem(&["plan", "-d", domain, "-p", "p.pddl", "--no-store"]).success());
    assert_run!(lab.rmem(&["validate", domain, "p.pddl", "broken.plan", "missing.plan", "good.plan"]), @r"
    good.plan: the plan is valid, value 5
    ------- stderr -------
    error: broken.plan:1:3: expected `)`, found the end of the line
      |
    1 | (a
      |   ^
    error: cannot read missing.plan: there is no such file or folder
    [exit code: 3]
    ");
    let json = lab.rmem(&["validate", domain, "p.pddl", "good.plan", "broken.plan", "--format", "json"]).exits(3);
    let reports: Value = serde_json::from_str(&json.stdout).unwrap();
    assert_eq!([&reports[0]["valid"], &reports[1]["valid"]], [&json!(true), &Value::Null]);
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

#[test]
fn moments_stand_in_durative_actions_where_each_condition_and_effect_has_one() {
    let lab = Lab::new();
    let head = "(define (domain d) (:requirements :durative-actions) (:predicates (p ?x) (q ?x))\n";
    let instant = "(:action act :parameters (?x) :precondition (over all (p ?x)) :effect (at end (q ?x))))";
    lab.write("instant.pddl", &format!("{head}{instant}"));
    assert_run!(lab.rmem(&["validate", "instant.pddl"]), @r"
    ------- stderr -------
    error: instant.pddl:2:45: `at start`, `at end` and `over all` stand in a :durative-action only
      |
    2 | (:action act :parameters (?x) :precondition (over all (p ?x)) :effect (at end (q ?x))))
      |                                             ^^^^^^^^^^^^^^^^^
      = hint: in an :action, conditions hold before it and effects happen at once; leave them out
    [exit code: 3]
    ");
    let timeless = "(:durative-action act :parameters (?x) :duration (= ?duration 2)\n\
                    :condition (and (at start (q ?x)) (p ?x))\n:effect (and (at start (not (p ?x))) (q ?x))))";
    lab.write("timeless.pddl", &format!("{head}{timeless}"));
    assert_run!(lab.rmem(&["validate", "timeless.pddl"]), @r"
    domain d is valid
    ------- stderr -------
    warning: timeless.pddl:3:35: no moment is named, so this is asked at the start; write (at start …), (over all …) or (at end …)
      |
    3 | :condition (and (at start (q ?x)) (p ?x))
      |                                   ^^^^^^
    warning: timeless.pddl:4:38: no moment is named, so this happens at the end; write (at start …) or (at end …)
      |
    4 | :effect (and (at start (not (p ?x))) (q ?x))))
      |                                      ^^^^^^
    [exit code: 0]
    ");
    let precondition = "(:durative-action act :parameters (?x) :duration (= ?duration 2) :precondition (p ?x)))";
    lab.write("precondition.pddl", &format!("{head}{precondition}"));
    assert_run!(lab.rmem(&["validate", "precondition.pddl"]), @r"
    ------- stderr -------
    error: precondition.pddl:2:66: in action `act`: expected `)`, `:condition`, `:duration`, `:effect`, or `:parameters (…)`, found `:precondition`
      |
    2 | (:durative-action act :parameters (?x) :duration (= ?duration 2) :precondition (p ?x)))
      |                                                                  ^^^^^^^^^^^^^
      = hint: this is written (:durative-action NAME :parameters (…) :duration (= ?duration …) :condition (…) :effect (…))
    [exit code: 3]
    ");
}

#[test]
fn what_is_no_fact_in_the_initial_state_is_named() {
    let lab = Lab::new();
    lab.write("d.pddl", "(define (domain d) (:predicates (p ?x) (q ?x)))");
    lab.write("p.pddl", "(define (problem a) (:domain d) (:objects o) (:init (and (p o) (q o))) (:goal (p o)))");
    assert_run!(lab.rmem(&["validate", "d.pddl", "p.pddl"]), @r"
    ------- stderr -------
    error: p.pddl:1:54: `and` cannot stand in `:init`, which lists facts and values
      |
    1 | (define (problem a) (:domain d) (:objects o) (:init (and (p o) (q o))) (:goal (p o)))
      |                                                      ^^^
      = hint: write them one after the other: (:init (NAME OBJECT …) (= (FUNCTION OBJECT …) NUMBER) …)
    [exit code: 3]
    ");
    let lab = Lab::new();
    lab.write("d.pddl", "(define (domain d) (:predicates (and ?x)))");
    lab.write("p.pddl", "(define (problem a) (:domain d) (:objects o) (:init (and o)) (:goal (and)))");
    lab.rmem(&["validate", "d.pddl", "p.pddl"]).success();
}

#[test]
fn a_bracket_that_the_last_action_lacks_is_said_where_it_lacks() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:predicates (p) (q))\n(:action act :precondition (and (p)\n:effect (q)))\n",
    );
    assert_run!(lab.rmem(&["validate", "d.pddl"]), @r"
    ------- stderr -------
    error: d.pddl:3:1: in action `act`, in its precondition: expected `)` or a condition, found `:effect`
      |
    3 | :effect (q)))
      | ^^^^^^^
      = hint: this is written (:action NAME :parameters (…) :precondition (…) :effect (…))
    [exit code: 3]
    ");
}

/// A domain with a constant, and a dash without its blank.
const SCENARIO: &str = "(define (domain hello) (:requirements :typing) (:types text robot)
 (:constants HELLO - text) (:predicates (said ?t - text ?r - robot))
 (:action say :parameters (?r -robot ?t - text) :effect (said ?t ?r)))";

#[test]
fn objects_that_repeat_a_constant_and_tight_dashes_are_warned_of() {
    let lab = Lab::new();
    lab.write("d.pddl", SCENARIO);
    lab.write(
        "p.pddl",
        "(define (problem p) (:domain hello) (:objects HELLO BYE - text R1 -robot) (:init) (:goal (said HELLO R1)))",
    );
    assert_run!(lab.rmem(&["validate", "d.pddl", "p.pddl"]), @r"
    problem p is valid
    ------- stderr -------
    warning: d.pddl:3:31: `-robot` is read as the type `- robot`; write a blank behind the dash
      |
    3 |  (:action say :parameters (?r -robot ?t - text) :effect (said ?t ?r)))
      |                               ^^^^^^
    warning: p.pddl:1:47: object `HELLO` is a constant of the domain already; leave it out here
      |
    1 | (define (problem p) (:domain hello) (:objects HELLO BYE - text R1 -robot) (:init) (:goal (said HELLO
      |                                               ^^^^^
    warning: p.pddl:1:67: `-robot` is read as the type `- robot`; write a blank behind the dash
      |
    1 | (define (problem p) (:domain hello) (:objects HELLO BYE - text R1 -robot) (:init) (:goal (said HELLO
      |                                                                   ^^^^^^
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]), @r"
    (say R1 HELLO)
    ; cost = 1 (unit cost)
    ------- stderr -------
    warning: d.pddl:3:31: `-robot` is read as the type `- robot`; write a blank behind the dash
      |
    3 |  (:action say :parameters (?r -robot ?t - text) :effect (said ?t ?r)))
      |                               ^^^^^^
    warning: p.pddl:1:47: object `HELLO` is a constant of the domain already; leave it out here
      |
    1 | (define (problem p) (:domain hello) (:objects HELLO BYE - text R1 -robot) (:init) (:goal (said HELLO
      |                                               ^^^^^
    warning: p.pddl:1:67: `-robot` is read as the type `- robot`; write a blank behind the dash
      |
    1 | (define (problem p) (:domain hello) (:objects HELLO BYE - text R1 -robot) (:init) (:goal (said HELLO
      |                                                                   ^^^^^^
    [exit code: 0]
    ");
    lab.write("t.j2", "(define (problem p) (:domain hello)\n(:objects {{ 'HELLO' }} - text R1 - robot)\n(:init) (:goal (said HELLO R1)))");
    assert_run!(lab.rmem(&["--memory", "mem:", "gen-problem", "-d", "d.pddl", "-t", "t.j2"]), @r"
    (define (problem p) (:domain hello)
    (:objects HELLO - text R1 - robot)
    (:init) (:goal (said HELLO R1)))------- stderr -------
    warning: d.pddl:3:31: `-robot` is read as the type `- robot`; write a blank behind the dash
      |
    3 |  (:action say :parameters (?r -robot ?t - text) :effect (said ?t ?r)))
      |                               ^^^^^^
    warning: t.j2:2:11: object `HELLO` is a constant of the domain already; leave it out here
      |
    2 | (:objects {{ 'HELLO' }} - text R1 - robot)
      |           ^^^^^^^^^^^^^
      = hint: it became line 2 of the problem: (:objects HELLO - text R1 - robot)
    [exit code: 0]
    ");
    lab.write(
        "p.pddl",
        "(define (problem p) (:domain hello) (:objects HELLO R1 - robot) (:init) (:goal (said HELLO R1)))",
    );
    assert_run!(lab.rmem(&["validate", "d.pddl", "p.pddl"]), @r"
    ------- stderr -------
    warning: d.pddl:3:31: `-robot` is read as the type `- robot`; write a blank behind the dash
      |
    3 |  (:action say :parameters (?r -robot ?t - text) :effect (said ?t ?r)))
      |                               ^^^^^^
    error: p.pddl:1:47: object `HELLO` is already a constant of the domain, of another type
      |
    1 | (define (problem p) (:domain hello) (:objects HELLO R1 - robot) (:init) (:goal (said HELLO R1)))
      |                                               ^^^^^
      = hint: the domain calls it `HELLO`; leave it out of `:objects`
    [exit code: 3]
    ");
}

#[test]
fn a_template_in_the_place_of_a_problem_gets_the_command_for_it() {
    let lab = Lab::new();
    lab.write("d.pddl", "(define (domain d) (:predicates (p ?x)))");
    lab.write("p.pddl", "; {{ }}\n(define (problem p) (:domain d) (:objects {{ a }}) (:init (p b)) (:goal (and)))");
    assert_run!(lab.rmem(&["validate", "d.pddl", "p.pddl"]), @r"
    ------- stderr -------
    error: p.pddl:2:62: object `b` is not declared
      |
    2 | (define (problem p) (:domain d) (:objects {{ a }}) (:init (p b)) (:goal (and)))
      |                                                              ^
      = hint: this is a template; a problem is made of it and checked by: rmem gen-problem --template p.pddl --domain DOMAIN
    [exit code: 3]
    ");
    lab.write("p.pddl", "(define (problem p) (:domain d) (:objects <<#X|{a:1}>> <<n>> <</X>>) (:init) (:goal (and)))");
    assert_run!(lab.rmem(&["validate", "d.pddl", "p.pddl"]), @r"
    problem p is valid
    ------- stderr -------
    warning: p.pddl:1:43: `<<#` begins a part of a template, and is read as PDDL here
      |
    1 | (define (problem p) (:domain d) (:objects <<#X|{a:1}>> <<n>> <</X>>) (:init) (:goal (and)))
      |                                           ^^^
      = hint: where it is a template, a problem is made of it and checked by: rmem gen-problem --template p.pddl --domain DOMAIN
    [exit code: 0]
    ");
    let run = lab.rmem(&["validate", "p.pddl"]).exits(3);
    assert!(run.stderr.contains("  = hint: this is a template; a problem is made of it and checked by"), "{run}");
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init (p b)) (:goal (and))) ; {% <<#");
    let run = lab.rmem(&["validate", "d.pddl", "p.pddl"]).exits(3);
    assert!(!run.stderr.contains("template"), "{run}");
}

#[test]
fn an_action_that_is_declared_again_with_the_same_text_is_a_warning() {
    let lab = Lab::new();
    let domain = |again: &str| {
        format!(
            "(define (domain d) (:requirements :durative-actions) (:predicates (p) (q))\n \
             (:action a :parameters () :precondition (p) :effect (q))\n {again})"
        )
    };
    lab.write("d.pddl", &domain("(:action a :parameters ()\n   ; the same\n   :precondition (p) :effect (q))"));
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init (p)) (:goal (q)))");
    assert_run!(lab.rmem(&["--memory", "mem:", "plan", "-d", "d.pddl", "-p", "p.pddl"]), @r"
    (a)
    ; cost = 1 (unit cost)
    ------- stderr -------
    warning: d.pddl:3:11: action `a` is declared twice, as at 2:11; leave one of them out
      |
    3 |  (:action a :parameters ()
      |           ^
    stored in robmem.plans as [ID]
    [exit code: 0]
    ");
    for again in [
        "(:action a :parameters () :precondition (q) :effect (p))",
        "(:action a :precondition (p) :effect (q) :parameters (?x))",
        "(:durative-action a :parameters () :duration (= ?duration 1) :condition (at start (p)) :effect (at end (q)))",
    ] {
        lab.write("d.pddl", &domain(again));
        let run = lab.rmem(&["validate", "d.pddl"]).exits(3);
        assert!(run.stderr.contains("is declared twice\n"), "{run}");
    }
}

#[test]
fn multi_agent_pddl_ends_in_34_with_its_name() {
    let lab = Lab::new();
    let problem = "(define (problem p) (:domain d) (:objects a - agent";
    for (text, place, what) in [
        ("(:action go :agent ?a - agent :parameters () :effect (p))", "2:14", "actions with an agent (`:agent`)"),
        ("(:requirements :multi-agent :factored-privacy)", "2:30", "private facts of agents (`:factored-privacy`)"),
        ("(:requirements :unfactored-privacy)", "2:17", "private facts of agents (`:unfactored-privacy`)"),
        ("(:predicates (p) (:private (r)))", "2:20", "private facts of agents (`:private`)"),
    ] {
        lab.write("d.pddl", &format!("(define (domain d) (:types agent)\n {text})"));
        let run = lab.rmem(&["validate", "d.pddl"]).exits(34);
        let wanted = format!("error: d.pddl:{place}: no planner of rmem can handle {what}\n");
        assert!(run.stderr.starts_with(&wanted), "{run}");
        assert!(run.stderr.contains("= hint: rmem plans one problem for all agents"), "{run}");
    }
    lab.write("d.pddl", "(define (domain d) (:requirements :typing) (:types agent) (:predicates (p)))");
    lab.write("p.pddl", &format!("{problem}\n (:private b - agent)) (:init) (:goal (p)))"));
    let run = lab.rmem(&["validate", "d.pddl", "p.pddl"]).exits(34);
    assert!(run.stderr.starts_with("error: p.pddl:2:3: no planner of rmem can handle private facts"), "{run}");
}

#[test]
fn parts_of_other_languages_end_in_34_with_their_name() {
    let lab = Lab::new();
    let domain = |effect: &str| {
        format!(
            "(define (domain d) (:predicates (p) (q))\n (:action a :parameters ()\n  :precondition (p)\n  {effect}))"
        )
    };
    for (effect, line) in [
        (":effect (probabilistic 0.8 (q))", "4:12: no planner of rmem can handle probabilistic effects"),
        (":effect (and (probabilistic 0.8 (and (q))))", "4:17: no planner of rmem can handle probabilistic effects"),
        (":observe (q)", "4:3: no planner of rmem can handle sensing actions (`:observe`)"),
    ] {
        lab.write("d.pddl", &domain(effect));
        let run = lab.rmem(&["validate", "d.pddl"]).exits(34);
        assert!(run.stderr.starts_with(&format!("error: d.pddl:{line}")), "{run}");
    }
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init) (:goal (q)))");
    lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]).exits(34);
    let section = "(:process fall :parameters () :precondition (p) :effect (increase (h) #t))";
    for (section, what) in [
        (section.to_owned(), "2:3: no planner of rmem can handle processes (`:process`)"),
        (section.replace("process", "event"), "2:3: no planner of rmem can handle events (`:event`)"),
        (
            "(:requirements :non-deterministic)".to_owned(),
            "2:17: no planner of rmem can handle nondeterministic effects",
        ),
    ] {
        lab.write("d.pddl", &format!("(define (domain d)\n {section} (:predicates (p)) (:functions (h)))"));
        let run = lab.rmem(&["validate", "d.pddl"]).exits(34);
        assert!(run.stderr.starts_with(&format!("error: d.pddl:{what}")), "{run}");
    }
    let domain =
        "(define (domain d) (:requirements :timed-initial-literals :fluents) (:predicates (p)) (:functions (h)))";
    lab.write("d.pddl", domain);
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init (at 3 (p))\n (at 4 (= (h) 6))) (:goal (p)))");
    let run = lab.rmem(&["validate", "d.pddl", "p.pddl"]).exits(34);
    assert!(run.stderr.starts_with("error: p.pddl:2:9: no planner of rmem can handle numbers that are set"), "{run}");
}

#[test]
fn comments_of_pddl_and_of_plans_may_have_any_bytes() {
    let lab = Lab::new();
    let write = |name: &str, bytes: &[u8]| std::fs::write(lab.path().join(name), bytes).unwrap();
    write("d.pddl", b"; Gr\xfc\xdfe\n(define (domain d) (:predicates (p)) ; \xe4\n (:action a :effect (p)))\n");
    write("p.pddl", b";\xff\n(define (problem p) (:domain d) (:init) (:goal (p)))");
    write("plan", b"(a) ; \xfc\n");
    lab.rmem(&["validate", "d.pddl", "p.pddl", "plan"]).success();
    lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]).success();
    lab.rmem(&["--memory", "mem:", "plan", "import", "plan", "-d", "d.pddl", "-p", "p.pddl"]).success();
    write("bad.pddl", b"; \xfc\n(define (domain \xfc) (:predicates (p)))");
    let run = lab.rmem(&["validate", "bad.pddl"]).exits(3);
    assert!(run.stderr.contains("bad.pddl:2:17: expected UTF-8 text"), "{run}");
}

#[test]
fn derived_predicates_that_explode_end_in_an_error() {
    let lab = Lab::new();
    let objects: Vec<String> = (0..40).map(|number| format!("o{number}")).collect();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :adl :derived-predicates) (:predicates (Near ?a ?b ?c ?d ?e ?f) (done) (e ?a ?b))
          (:derived (Near ?a ?b ?c ?d ?e ?f) (and (not (e ?a ?b)) (not (e ?c ?d)) (not (e ?e ?f))))
          (:action huge :parameters (?a) :precondition (exists (?b ?c ?d ?e ?f) (Near ?a ?b ?c ?d ?e ?f))
            :effect (done)))",
    );
    let problem = format!("(define (problem p) (:domain d) (:objects {}) (:init) (:goal (done)))", objects.join(" "));
    lab.write("p.pddl", &problem);
    lab.write("plan", "(huge o1)\n");
    let run = lab.rmem(&["validate", "d.pddl", "p.pddl", "plan"]);
    assert!(run.code != 0, "{run}");
    let said = [run.stdout.as_str(), run.stderr.as_str()].concat();
    assert!(said.contains("the derived predicate `Near` has more than 4000000 facts"), "{run}");
}

#[test]
fn plans_are_found_in_what_planners_print() {
    let lab = Lab::new();
    let tasks = "fixtures/transcripts/tasks";
    for (planner, case, domain, problem) in [
        ("ff", "p_plan", "dom", "p_plan"),
        ("ff", "p_goaltrue", "dom", "p_goaltrue"),
        ("metric-ff", "num", "ndom", "np"),
        ("fast-downward", "p_plan", "dom", "p_plan"),
        ("fast-downward", "p_goaltrue", "dom", "p_goaltrue"),
        ("lpg", "p_plan", "dom", "p_plan"),
        ("lpg", "num", "ndom", "np"),
        ("lpg", "durative", "durdom", "durp"),
    ] {
        let recorded = lab.read(&format!("fixtures/transcripts/{planner}/{case}.txt"));
        let output = recorded.split("[exit code").next().unwrap().split_once('\n').unwrap().1;
        lab.write("out.txt", output);
        let task = [format!("{tasks}/{domain}.pddl"), format!("{tasks}/{problem}.pddl")];
        let run = lab.rmem(&["validate", &task[0], &task[1], "out.txt"]);
        assert!(run.code == 0 && run.stdout.contains("the plan is valid"), "{planner} {case}: {run}");
    }
    let import = ["plan", "import", "out.txt", "-d", "fixtures/transcripts/tasks/durdom.pddl"];
    let import = [&import[..], &["-p", "fixtures/transcripts/tasks/durp.pddl", "-q"]].concat();
    lab.rmem(&import).success();
    // What is no plan is said, and not taken for the empty one.
    let unsolvable = lab.read("fixtures/transcripts/fast-downward/p_goalfalse_unreach.txt");
    lab.write("out.txt", unsolvable.split("[exit code").next().unwrap().split_once('\n').unwrap().1);
    let words =
        ["validate", "fixtures/transcripts/tasks/dom.pddl", "fixtures/transcripts/tasks/p_goalfalse_unreach.pddl"];
    let run = lab.rmem(&[&words[..], &["out.txt"]].concat()).exits(3);
    assert!(run.stderr.contains("the planner's output has no plan"), "{run}");
    for (planner, case) in [("ff", "p_plan"), ("fast-downward", "p_plan"), ("lpg", "p_plan")] {
        let path = crate::lab::root().join(format!("fixtures/transcripts/{planner}/{case}.txt"));
        let command = format!("sed -e '/^.exit code/,$d' -e 1d {}", path.display());
        lab.write(
            "rmem.toml",
            &format!("memory = 'mem:'\n[planner.any]\ncommand = ['/bin/sh', '-c', \"{command}\"]\noutput = 'auto'\n"),
        );
        let words = ["plan", "--planner", "any", "-d", "fixtures/transcripts/tasks/dom.pddl"];
        let found = lab.rmem(&[&words[..], &["-p", "fixtures/transcripts/tasks/p_plan.pddl", "--no-store"]].concat());
        assert!(found.code == 0 && found.stdout.to_lowercase().contains("(drop r2 ball b)"), "{planner}: {found}");
    }
}

#[test]
fn a_plan_reads_alike_from_a_file_and_from_a_planner() {
    let lab = Lab::new();
    let recorded = |planner: &str| {
        let text = lab.read(&format!("fixtures/transcripts/{planner}/p_plan.txt"));
        text.split("[exit code").next().unwrap().split_once('\n').unwrap().1.to_owned()
    };
    let (log, ff) = (recorded("fast-downward"), recorded("ff"));
    let logged: Vec<&str> = log.lines().filter(|line| line.ends_with(" (1)")).collect();
    let steps: Vec<&str> = logged.iter().map(|line| line.trim_end_matches(" (1)")).collect();
    let lines = |line: &dyn Fn(usize, &str) -> String| -> String {
        steps.iter().enumerate().map(|(at, step)| line(at, step) + "\n").collect()
    };
    let bare = lines(&|_, step| format!("({step})"));
    let whole = format!("{bare}; cost = 8 (unit cost)\n");
    let numbered = lines(&|at, step| format!("{at}: {step}"));
    let timed = lines(&|at, step| format!("{at}.000: ({step}) [1.000]"));
    let together = lines(&|_, step| format!("0.000: ({step}) [1.000]"));
    let backwards = |text: &str| text.lines().rev().map(|line| format!("{line}\n")).collect::<String>();
    let gap = lines(&|at, step| if at == 3 { String::new() } else { format!("{at}: {step}") });
    let tasks = ["fixtures/transcripts/tasks/dom.pddl", "fixtures/transcripts/tasks/p_plan.pddl"];
    for (text, verdict) in [
        (logged.join("\n"), "the plan is valid, value 8"),
        (bare.clone(), "the plan is valid, value 8"),
        (format!("{log}{whole}"), "the plan is valid, value 8"),
        (format!("{whole}{log}"), "the plan is valid, value 8"),
        (format!("{log}{log}"), "the plan is valid, value 8"),
        (numbered.repeat(2), "the plan is valid, value 8"),
        // Without time in the task, steps of one time are in the order of the file.
        (backwards(&timed), "the plan is valid, value 8"),
        (backwards(&together), "the plan is invalid"),
        (together, "the plan is valid, value 8"),
        // Of several plans, the last counts, in whichever spelling.
        (format!("{ff}{numbered}"), "the plan is valid, value 8"),
        (format!("{ff}{whole}"), "the plan is valid, value 8"),
        (format!("{log}{ff}"), "the plan is valid, value 10"),
        (format!("{log}(drop)\n"), "the plan is invalid"),
        (format!("{log}0: drop\n"), "the plan is invalid"),
        (format!("{log}{timed}"), "the plan is valid, value 8"),
        (format!("{}\n(drop)\n", logged.join("\n")), "the plan is invalid: step 1"),
        (format!("{log}3: drop\n"), "expected a step like those before, or step 0 of another plan"),
        (format!("; Plan found with metric 8\n{timed}9.000: drop\n"), "found a step without brackets"),
        // The same steps again, with nothing between, may be meant.
        (bare.repeat(2), "the plan is invalid: step 9"),
        (gap, "out:5:1: expected step 3, found step 4; lines of the plan are missing"),
        (ff.replace("        3:", "       13:"), "expected step 3, found step 13; lines of the plan are missing"),
    ] {
        lab.write("out", &text);
        let read = lab.rmem(&["validate", tasks[0], tasks[1], "out"]);
        assert!([&read.stdout, &read.stderr].iter().any(|said| said.contains(verdict)), "{text}\n{verdict}\n{read}");
        let place = lab.path().join("out").display().to_string();
        lab.write(
            "rmem.toml",
            &format!("memory = 'mem:'\n[planner.any]\ncommand = ['cat', '{place}']\noutput = 'auto'\n"),
        );
        let ran = lab.rmem(&["plan", "--planner", "any", "-d", tasks[0], "-p", tasks[1], "--no-store"]);
        assert_eq!(ran.code == 0, read.code == 0, "{text}\n{read}\n{ran}");
    }
    // A planner may print several plans; a file without its sentences is one.
    for text in [whole.repeat(2), timed.repeat(2)] {
        lab.write("out", &text);
        let read = lab.rmem(&["validate", tasks[0], tasks[1], "out"]);
        assert!(read.stdout.contains("the plan is invalid"), "{text}\n{read}");
        lab.rmem(&["plan", "--planner", "any", "-d", tasks[0], "-p", tasks[1], "--no-store"]).success();
    }
}

#[test]
fn no_part_of_a_plan_file_is_left_out() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain s) (:requirements :durative-actions :typing) (:types r) (:predicates (p) (q) (k ?x - r))
          (:durative-action b :parameters () :duration (= ?duration 2) :condition (at start (p)) :effect (at end (q)))
          (:durative-action c :parameters (?x - r) :duration (= ?duration 1) :condition (and)
            :effect (at end (k ?x))))",
    );
    lab.write("p.pddl", "(define (problem s) (:domain s) (:objects x - r) (:init) (:goal (k x)))");
    for text in [
        "; robot 1\n0: (b) [2]\n2.1: (b) [2]\n; robot 2\n0: (c x) [1]\n",
        "0: (b) [2]\n2.1: (b) [2]\n\n0: (c x) [1]\n",
        "0: (b) [2]\n0: (c x) [1]\n3: (c x) [1]\n0: (b) [2]\n",
    ] {
        lab.write("plan", text);
        let run = lab.rmem(&["validate", "d.pddl", "p.pddl", "plan"]).exits(1);
        assert!(run.stdout.contains("step 1: (b) is not applicable"), "{text}\n{run}");
        lab.rmem(&["--memory", "mem:", "plan", "import", "plan", "-d", "d.pddl", "-p", "p.pddl"]).exits(1);
    }
}

#[test]
fn a_plan_in_the_place_of_a_problem_is_said_to_be_no_problem() {
    let lab = Lab::new();
    lab.write("d.pddl", "(define (domain d) (:predicates (a)))");
    lab.write("p.plan", "(go hall)\n(take cup)\n");
    let run = lab.rmem(&["validate", "d.pddl", "p.plan"]).exits(3);
    assert!(run.stderr.contains("p.plan:1:2: expected `(define`, found `go`"), "{run}");
}

#[test]
fn a_cost_in_a_plan_file_that_is_not_the_true_one_is_said() {
    let lab = Lab::new();
    lab.write("p.pddl", &problem(&lab));
    let domain = "domains/blocksworld/domain.pddl";
    let plan = lab.rmem(&["plan", "-d", domain, "-p", "p.pddl", "--no-store"]).success();
    let steps: String = plan.lines().filter(|line| line.starts_with('(')).map(|line| format!("{line}\n")).collect();
    lab.write("plan", &format!("{steps}; cost = 4 (unit cost)\n"));
    let said = lab.rmem(&["validate", domain, "p.pddl", "plan"]).success();
    assert_eq!(said, "the plan is valid, value 5\n  the file says that its cost is 4\n");
    // Metric-FF's last step is no action.
    let numbered: String =
        (0..).zip(steps.lines()).map(|(at, step)| format!("{at}: {}\n", step.trim_matches(['(', ')']))).collect();
    let printed = format!("ff: found legal plan as follows\n\nstep {numbered}5: REACH-GOAL\n\ntime spent: 0.00\n");
    lab.write("plan", &printed);
    assert_eq!(lab.rmem(&["validate", domain, "p.pddl", "plan"]).success(), "the plan is valid, value 5\n");
}

#[test]
fn a_plan_that_cannot_be_read_is_an_entry_of_the_json_alone_and_among_others() {
    let lab = Lab::new();
    lab.write("p.pddl", PROBLEM_OF_ONE);
    let domain = "domains/blocksworld/domain.pddl";
    for plans in [&["absent.txt"][..], &["absent.txt", "gone.txt"]] {
        let run = lab.rmem(&[&["validate", domain, "p.pddl"], plans, &["--format", "json"]].concat());
        assert_ne!(run.code, 0, "{run}");
        let printed: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        let entries = printed.as_array().unwrap();
        assert_eq!(entries.len(), plans.len());
        for (entry, plan) in entries.iter().zip(plans) {
            assert_eq!((entry["plan"].as_str(), entry["valid"].is_null()), (Some(*plan), true));
            assert!(entry["message"].as_str().unwrap().contains(plan), "{run}");
        }
        assert!(run.stderr.contains("absent.txt"), "{run}");
    }
}

/// A problem of the blocks world whose goal holds.
const PROBLEM_OF_ONE: &str =
    "(define (problem p) (:domain blocksworld) (:objects A) (:init (on-table A) (clear A)) (:goal (on-table A)))";
