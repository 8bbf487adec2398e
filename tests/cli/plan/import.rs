//! plan import.

use crate::lab::{Lab, TASK, assert_run, plan};

#[test]
fn a_plan_from_a_file_is_stored_if_it_is_valid() {
    let lab = Lab::new();
    let text = plan(&lab, &["-q", "--no-store"]).success();
    lab.write("ipc.plan", &text);
    lab.write(
        "ff.plan",
        &plan(&lab, &["-q", "--no-store", "--format", "ff"])
            .success()
            .to_uppercase()
            .replace("FF: FOUND LEGAL PLAN AS FOLLOWS", "ff: found legal plan as follows")
            .replace("STEP", "step"),
    );
    for file in ["ipc.plan", "ff.plan"] {
        let id = lab.rmem(&[&["plan", "import", file], &TASK[2..]].concat()).success();
        assert_eq!(lab.rmem(&["plan", "show", id.trim()]).success(), text);
        assert!(lab.rmem(&["plan", "why", "last"]).success().contains(&format!("command     {file}")));
    }
    lab.write("bad.plan", &text.lines().skip(1).collect::<Vec<_>>().join("\n"));
    assert_run!(lab.rmem(&[&["plan", "import", "bad.plan"], &TASK[2..]].concat()), @r"
    ------- stderr -------
    error: bad.plan is not stored: the plan is invalid: step 1: (unstack D A) is not applicable: (hand-empty) is false
    (hand-empty): false in the initial state
      (putdown B) would make it true, and is applicable there
      (stack B C) would make it true, and is applicable there
    [exit code: 1]
    ");
    lab.write("no.plan", "(stack B");
    assert_run!(lab.rmem(&[&["plan", "import", "no.plan"], &TASK[2..]].concat()), @r"
    ------- stderr -------
    error: no.plan:1:9: expected `)`, found the end of the text
      |
    1 | (stack B
      |         ^
    [exit code: 3]
    ");
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "2\n");
}

#[test]
fn an_import_says_what_is_odd_in_what_it_read() {
    let lab = Lab::new();
    let domain = "(define (domain d) (:requirements :strips) (:constants o) (:predicates (a) (b))
      (:action go :parameters (?x) :precondition (not (b)) :effect (b)))";
    lab.write("d.pddl", domain);
    lab.write("p.j2", "(define (problem p) (:domain d) (:objects o) (:init (a) (a)) (:goal (b)))\n");
    lab.write("go.plan", "(go o)\n");
    assert_run!(lab.rmem(&["-q", "--memory", "mem:", "plan", "import", "go.plan", "-d", "d.pddl", "-t", "p.j2"]), @r"
    [ID]
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["--memory", "mem:", "plan", "import", "go.plan", "-d", "d.pddl", "-t", "p.j2"]), @r"
    [ID]
    ------- stderr -------
    warning: d.pddl:2:55: this needs `:negative-preconditions`, which `:requirements` does not list
      |
    2 |       (:action go :parameters (?x) :precondition (not (b)) :effect (b)))
      |                                                       ^^^
    warning: p.j2:1:43: object `o` is a constant of the domain already; leave it out here
      |
    1 | (define (problem p) (:domain d) (:objects o) (:init (a) (a)) (:goal (b)))
      |                                           ^
      = hint: it became line 1 of the problem: (define (problem p) (:domain d) (:objects o) (:init (a) (a)) (:goal (b)))
    stored in robmem.plans as [ID]
    [exit code: 0]
    ");
}

#[test]
fn a_temporal_plan_from_a_file_is_stored_and_drawn() {
    let lab = Lab::new();
    let task = ["-d", "fixtures/pddl/tasks/durdom.pddl", "-p", "fixtures/pddl/tasks/durp.pddl"];
    let text = lab.rmem(&[&["plan", "--no-store", "-q"], &task[..]].concat()).success();
    lab.write("t.plan", &text);
    lab.rmem(&[&["plan", "import", "t.plan"], &task[..]].concat()).success();
    assert_eq!(lab.rmem(&["plan", "show", "last"]).success(), text);
    assert!(lab.rmem(&["plan", "show", "last", "--format", "svg"]).success().contains("<rect"));
    lab.rmem(&["plan", "check", "last"]).exits(0);
}

#[test]
fn an_action_that_takes_no_time_ends_when_it_starts() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :durative-actions) (:predicates (p) (q))
         (:durative-action wait :parameters () :duration (= ?duration 5) :effect (at end (p)))
         (:action press :parameters () :effect (q)))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init) (:goal (q)))");
    lab.write("t.plan", "0.5: (press) [1.0]\n");
    let task = ["-d", "d.pddl", "-p", "p.pddl"];
    let json = lab.rmem(&[&["-q", "plan", "import", "t.plan", "--format", "json"], &task[..]].concat()).success();
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&report["cost"], &report["makespan"]), (&0.5.into(), &0.5.into()));
    assert_eq!(report["steps"][0]["duration"], 0);
    let verdict = lab.rmem(&["validate", "d.pddl", "p.pddl", "t.plan"]).success();
    assert_eq!(verdict, "the plan is valid, makespan 0.5\n");
}
