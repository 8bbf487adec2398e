//! plan step.

use crate::lab::{Lab, assert_run, plan};

#[test]
fn steps_are_noted_with_their_times() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    for (step, state) in [("1", "--started"), ("1", "--done"), ("next", "--started"), ("3", "--failed")] {
        lab.rmem(&["plan", "step", "last", step, state]).success();
    }
    let stored = lab.rmem(&["query", "robmem.plans"]).success();
    let document: serde_json::Value = serde_json::from_str(stored.trim()).unwrap();
    let status = |step: &str| document[step]["_status"].clone();
    assert_eq!((status("1"), status("2"), status("3")), ("done".into(), "running".into(), "failed".into()));
    assert!(document["1"]["_started"]["$date"].is_string() && document["1"]["_ended"]["$date"].is_string());
    assert!(document["2"]["_ended"].is_null() && document["4"]["_status"].is_null(), "{stored}");
    assert_run!(lab.rmem(&["plan", "show", "last"]), @r"
    (stack B C) ; done
    (unstack D A) ; running
    (putdown D) ; failed
    (pickup A)
    (stack A B)
    ; cost = 5 (unit cost)
    ------- stderr -------
    [exit code: 0]
    ");
    lab.rmem(&["plan", "step", "last", "3", "--open"]).success();
    assert!(!lab.rmem(&["query", "robmem.plans"]).success().contains("failed"));
    let wrong = ["0", "6", "x", "-1"].map(|step| ["plan", "step", "last", "--done", "--", step]);
    assert_run!(lab.transcript(&wrong.each_ref().map(|args| &args[..])), @r"
    $ rmem plan step last --done -- 0
    ------- stderr -------
    error: the plan has 5 steps; expected a number from 1 to 5, found 0
    [exit code: 2]
    $ rmem plan step last --done -- 6
    ------- stderr -------
    error: the plan has 5 steps; expected a number from 1 to 5, found 6
    [exit code: 2]
    $ rmem plan step last --done -- x
    ------- stderr -------
    error: `x` is not a step; expected a number from 1, an action like '(pick A)', or `next`
    [exit code: 2]
    $ rmem plan step last --done -- -1
    ------- stderr -------
    error: `-1` is not a step; expected a number from 1, an action like '(pick A)', or `next`
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["plan", "step", "last", "1"]), @r"
    ------- stderr -------
    error: the following required arguments were not provided:
      <--started|--done|--failed|--open>

    Usage: rmem plan step <--started|--done|--failed|--open> <ID> <N>

    For more information, try '--help'.
    [exit code: 2]
    ");
}

#[test]
fn steps_of_the_other_layout_are_noted_too() {
    let lab = Lab::new();
    plan(&lab, &["-q", "--layout", "fawkes"]).success();
    lab.rmem(&["plan", "step", "last", "2", "--done", "--out-of-order"]).success();
    let stored = ["query", "robmem.plans", "{'actions.1.status': 'done'}", "--fields", "{'actions.ended': 1, _id: 0}"];
    assert_run!(lab.rmem(&stored), @r#"
    {"actions":[{},{"ended":{"$date":"[TIME]"}},{},{},{}]}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["plan", "show", "last", "--format", "clips"]), @r"
    (plan (id [ID]) (cost 5.0))
    (plan-action (id 1) (plan-id [ID]) (name stack) (arguments B C) (status FORMULATED))
    (plan-action (id 2) (plan-id [ID]) (name unstack) (arguments D A) (status FINAL))
    (plan-action (id 3) (plan-id [ID]) (name putdown) (arguments D) (status FORMULATED))
    (plan-action (id 4) (plan-id [ID]) (name pickup) (arguments A) (status FORMULATED))
    (plan-action (id 5) (plan-id [ID]) (name stack) (arguments A B) (status FORMULATED))
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn a_step_before_an_earlier_one_needs_an_option() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    assert_run!(lab.rmem(&["plan", "step", "last", "3", "--done"]), @r"
    ------- stderr -------
    error: step 3 cannot be done while step 1 is open; mark step 1 first, or use --out-of-order
    [exit code: 2]
    ");
    lab.rmem(&["plan", "step", "last", "3", "--done", "--out-of-order"]).success();
}

const TIMED: &str = "(define (domain d) (:requirements :strips :typing :durative-actions) (:types r p) (:predicates (free ?r - r) (cut ?p - p) (sold ?p - p))
  (:durative-action cut :parameters (?r - r ?p - p) :duration (= ?duration 5) :condition (at start (free ?r))
    :effect (and (at start (not (free ?r))) (at end (free ?r)) (at end (cut ?p))))
  (:durative-action sell :parameters (?p - p) :duration (= ?duration 2) :condition (at start (cut ?p)) :effect (at end (sold ?p))))";

#[test]
fn in_a_plan_with_times_a_step_waits_for_those_that_it_depends_on() {
    let lab = Lab::new();
    lab.write("d.pddl", TIMED);
    lab.write(
        "p.pddl",
        "(define (problem p) (:domain d) (:objects r1 r2 - r a b - p) (:init (free r1) (free r2)) (:goal (and (sold a) (sold b))))",
    );
    lab.write("t.plan", "0.0: (cut r1 a) [5]\n0.5: (cut r2 b) [5]\n5.1: (sell a) [2]\n7.2: (sell b) [2]\n");
    lab.rmem(&["plan", "import", "t.plan", "-d", "d.pddl", "-p", "p.pddl"]).success();
    let step = |number: &'static str, state: &'static str| ["-q", "plan", "step", "last", number, state];
    let commands = [
        step("1", "--started"),
        step("3", "--done"),
        // It overlaps the first, and the fourth depends on the second alone.
        step("2", "--done"),
        step("4", "--done"),
        step("1", "--done"),
        step("3", "--done"),
    ];
    assert_run!(lab.transcript(&commands.each_ref().map(|args| &args[..])), @r"
    $ rmem -q plan step last 1 --started
    ------- stderr -------
    [exit code: 0]
    $ rmem -q plan step last 3 --done
    ------- stderr -------
    error: step 3 cannot be done while step 1 is running; mark step 1 first, or use --out-of-order
    [exit code: 2]
    $ rmem -q plan step last 2 --done
    ------- stderr -------
    [exit code: 0]
    $ rmem -q plan step last 4 --done
    ------- stderr -------
    [exit code: 0]
    $ rmem -q plan step last 1 --done
    ------- stderr -------
    [exit code: 0]
    $ rmem -q plan step last 3 --done
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn a_step_waits_for_the_start_of_one_that_encloses_it_and_that_one_for_its_end() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :durative-actions) (:predicates (light) (mended))
  (:durative-action burn :parameters () :duration (= ?duration 8) :effect (and (at start (light)) (at end (not (light)))))
  (:durative-action mend :parameters () :duration (= ?duration 5) :condition (over all (light)) :effect (at end (mended))))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init) (:goal (mended)))");
    lab.write("t.plan", "0.0: (burn) [8]\n0.5: (mend) [5]\n");
    lab.rmem(&["plan", "import", "t.plan", "-d", "d.pddl", "-p", "p.pddl"]).success();
    let step = |number: &'static str, state: &'static str| ["-q", "plan", "step", "last", number, state];
    let commands = [
        step("2", "--done"),
        step("2", "--started"),
        step("1", "--started"),
        step("2", "--started"),
        step("1", "--done"),
        step("2", "--done"),
        step("1", "--done"),
    ];
    assert_run!(lab.transcript(&commands.each_ref().map(|args| &args[..])), @r"
    $ rmem -q plan step last 2 --done
    ------- stderr -------
    error: step 2 cannot be done while step 1 is open; mark step 1 as started first, or use --out-of-order
    [exit code: 2]
    $ rmem -q plan step last 2 --started
    ------- stderr -------
    error: step 2 cannot be started while step 1 is open; mark step 1 as started first, or use --out-of-order
    [exit code: 2]
    $ rmem -q plan step last 1 --started
    ------- stderr -------
    [exit code: 0]
    $ rmem -q plan step last 2 --started
    ------- stderr -------
    [exit code: 0]
    $ rmem -q plan step last 1 --done
    ------- stderr -------
    error: step 1 cannot be done while step 2 is running; mark step 2 first, or use --out-of-order
    [exit code: 2]
    $ rmem -q plan step last 2 --done
    ------- stderr -------
    [exit code: 0]
    $ rmem -q plan step last 1 --done
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn the_last_plan_is_no_run_without_a_plan() {
    let lab = Lab::new();
    lab.write("d.pddl", "(define (domain d) (:predicates (a) (b) (c)) (:action go :precondition (a) :effect (b)))");
    let problem = |goal: &str| format!("(define (problem p) (:domain d) (:init (a)) (:goal {goal}))");
    lab.write("go.pddl", &problem("(b)"));
    lab.write("no.pddl", &problem("(c)"));
    lab.write("nothing.pddl", &problem("(a)"));
    let plan = |file: &'static str| ["-q", "plan", "-d", "d.pddl", "-p", file];
    lab.rmem(&plan("no.pddl")).exits(11);
    assert_run!(lab.rmem(&["plan", "step", "last", "1", "--started"]), @r"
    ------- stderr -------
    error: no plan in robmem.plans has steps; the last run is [ID] (unsolvable)
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["plan", "show", "last"]), @r"
    ------- stderr -------
    error: [ID] has no plan: unsolvable
    [exit code: 3]
    ");
    lab.rmem(&plan("go.pddl")).success();
    lab.rmem(&plan("no.pddl")).exits(11);
    let last = |command: &'static str| ["plan", command, "last"];
    let commands = [last("show"), last("check")];
    assert_run!(lab.transcript(&commands.each_ref().map(|args| &args[..])), @r"
    $ rmem plan show last
    (go)
    ; cost = 1 (unit cost)
    ------- stderr -------
    last is [ID]; the run [ID] after it found no plan (unsolvable)
    [exit code: 0]
    $ rmem plan check last
    [ID] holds: 1 of 1 steps are left
    ------- stderr -------
    last is [ID]; the run [ID] after it found no plan (unsolvable)
    warning: the plan's problem was a file, which does not change with the memory: every step is simulated, from the file's initial state; give the present state with --problem
    [exit code: 0]
    ");
    assert!(lab.rmem(&["plan", "why", "last"]).success().contains("unsolvable"));
    lab.rmem(&plan("nothing.pddl")).success();
    assert_run!(lab.rmem(&["plan", "step", "last", "1", "--done"]), @r"
    ------- stderr -------
    last is [ID]; the run [ID] after it has no steps
    step 1 of [ID] is done: (go)
    [exit code: 0]
    ");
}

#[test]
fn a_step_that_is_noted_again_is_a_warning_and_one_that_cannot_start_an_error() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    let step = |number: &'static str, state: &'static str| ["plan", "step", "last", number, state];
    let commands = [step("2", "--started"), step("1", "--done"), step("1", "--done"), step("1", "--started")];
    assert_run!(lab.transcript(&commands.each_ref().map(|args| &args[..])), @r"
    $ rmem plan step last 2 --started
    ------- stderr -------
    error: step 2 cannot be started while step 1 is open; mark step 1 first, or use --out-of-order
    [exit code: 2]
    $ rmem plan step last 1 --done
    ------- stderr -------
    step 1 of [ID] is done: (stack B C)
    [exit code: 0]
    $ rmem plan step last 1 --done
    ------- stderr -------
    warning: step 1 was done already
    step 1 of [ID] is done: (stack B C)
    [exit code: 0]
    $ rmem plan step last 1 --started
    ------- stderr -------
    warning: step 1 was done; it is running again
    step 1 of [ID] is running: (stack B C)
    [exit code: 0]
    ");
    lab.rmem(&["plan", "step", "last", "3", "--started", "--out-of-order"]).success();
    lab.rmem(&["plan", "step", "last", "3", "--failed", "--out-of-order"]).exits(2);
}
