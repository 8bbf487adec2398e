//! plan check.

use super::STACKED;
use crate::lab::{Lab, TASK, assert_run, plan};

#[test]
fn a_plan_holds_until_the_world_changes_under_it() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r"
    [ID] holds: 5 of 5 steps are left
    ------- stderr -------
    [exit code: 0]
    ");
    // Its first step is (stack B C): done in the world and noted, the rest still holds.
    STACKED.iter().for_each(|line| drop(lab.shell(line).success()));
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r#"
    [ID] does not hold: step 1: (stack B C) is not applicable: (holding B) is false
      templates/blocksworld/problem.pddl.j2:24: not in the problem; it would be written by (holding {{ fact.object }})
        line 22: only if not (count(world, "{relation: 'holding'}") == 0)
      (holding B): false in the initial state
        (unstack B C) would make it true, and is applicable there
        (pickup B) would make it true, but needs (on-table B)
    ------- stderr -------
    [exit code: 1]
    "#);
    lab.rmem(&["plan", "step", "last", "1", "--done"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r"
    [ID] holds: 4 of 5 steps are left
    ------- stderr -------
    [exit code: 0]
    ");
    // A block is put where the next step needs a clear one.
    lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'clear', object: 'D'}"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r#"
    [ID] does not hold: step 2: (unstack D A) is not applicable: (clear D) is false
      templates/blocksworld/problem.pddl.j2:18: not in the problem; it would be written by (clear {{ fact.object }})
        line 17: query(world, "{relation: 'clear'}", sort="{object: 1}") asks {"relation":"clear"} in robmem.worldmodel: 1 document
      (clear D): false in the initial state
        (unstack ?x D) would make it true, but is not applicable there
        (putdown D) would make it true, but needs (holding D)
        (stack D ?y) would make it true, but needs (holding D)
    ------- stderr -------
    [exit code: 1]
    "#);
    let json = lab.rmem(&["plan", "check", "last", "--format", "json"]).exits(1).stdout;
    let verdict: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(verdict["step"], 2);
    assert_eq!(verdict["missing"], serde_json::json!(["(clear D)"]));
    assert_eq!((&verdict["left"], &verdict["holds"]), (&4.into(), &false.into()));
    // And what would make it hold.
    assert_eq!(verdict["repairs"][0]["condition"], "(clear D)");
    assert!(verdict["repairs"][0]["remedies"].as_array().is_some_and(|remedies| !remedies.is_empty()), "{verdict}");
}

#[test]
fn what_should_not_be_true_is_named_with_its_document() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :negative-preconditions) (:predicates (wet ?x) (done ?x))
         (:action go :parameters (?x) :precondition (not (wet ?x)) :effect (done ?x)))",
    );
    lab.write(
        "p.j2",
        "(define (problem p) (:domain d) (:objects a)\n (:init\n{% for f in query('lab.wet') %}\n(wet {{ f.place }})\n{% endfor %})\n (:goal (done a)))",
    );
    lab.rmem(&["plan", "-d", "d.pddl", "-t", "p.j2"]).success();
    lab.rmem(&["insert", "lab.wet", "{_id: 7, place: 'a'}"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r"
    [ID] does not hold: step 1: (go a) is not applicable: (not (wet a)) is false
      p.j2:4:1: (wet a) is in the memory
      document _id 7 of lab.wet
      (not (wet a)): false in the initial state
        no action makes it true; it has to hold in the initial state
    ------- stderr -------
    [exit code: 1]
    ");
}

#[test]
fn a_plan_whose_objects_are_gone_does_not_hold() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    lab.rmem(&["delete", "robmem.worldmodel", "{object: 'C'}", "--many"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r"
    [ID] does not hold: the problem cannot be instantiated any more:
    templates/blocksworld/problem.pddl.j2:29:10: object `C` is not declared
       |
    29 |   (:goal {{ goal }})
       |          ^^^^^^^^^^
       = hint: the goal is (and (on A B) (on B C))
       = hint: it became line 13 of the problem: (:goal (and (on A B) (on B C)))
    ------- stderr -------
    [exit code: 1]
    ");
}

#[test]
fn the_plan_of_a_problem_file_is_checked_against_the_state_that_is_given() {
    let lab = Lab::new();
    lab.write("p.pddl", &lab.rmem(&[&["gen-problem"], &TASK[..2], &TASK[4..]].concat()).success());
    lab.rmem(&["plan", "-d", "domains/blocksworld/domain.pddl", "-p", "p.pddl", "-q"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r"
    [ID] holds: 5 of 5 steps are left
    ------- stderr -------
    warning: the plan's problem was a file, which does not change with the memory: every step is simulated, from the file's initial state; give the present state with --problem
    [exit code: 0]
    ");
    STACKED.iter().for_each(|line| drop(lab.shell(line).success()));
    lab.rmem(&["plan", "step", "last", "next", "--done"]).success();
    let line = "rmem gen-problem -q -t templates/blocksworld/problem.pddl.j2 --goal '(and (on A B) (on B C))' \
                | rmem plan check last --problem -";
    assert_run!(lab.shell(line), @r"
    [ID] holds: 4 of 5 steps are left
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn a_plan_with_a_failed_step_does_not_hold_until_the_step_is_begun_again() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    lab.rmem(&["plan", "step", "last", "1", "--failed"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r"
    [ID] does not hold: step 1: it failed and was not started again
    ------- stderr -------
    [exit code: 1]
    ");
    lab.rmem(&["plan", "step", "last", "1", "--started"]).success();
    lab.rmem(&["plan", "check", "last"]).success();
}

#[test]
fn what_a_loop_left_out_is_said_with_its_query_and_its_condition() {
    let lab = Lab::new();
    lab.write("d.pddl", "(define (domain d) (:predicates (ready ?x) (done ?x)) (:action go :parameters (?x) :precondition (ready ?x) :effect (done ?x)))");
    lab.write(
        "p.j2",
        "(define (problem p) (:domain d) (:objects a)
 (:init
{% for m in query('lab.machines') if m.state == 'up' %}
  (ready {{ m.name }})
{% endfor %})
 (:goal (done a)))",
    );
    lab.rmem(&["insert", "-q", "lab.machines", "{_id: 1, name: 'a', state: 'up'}"]).success();
    lab.rmem(&["plan", "-q", "-d", "d.pddl", "-t", "p.j2"]).success();
    lab.rmem(&["update", "-q", "lab.machines", "{}", "{$set: {state: 'down'}}"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r"
    [ID] does not hold: step 1: (go a) is not applicable: (ready a) is false
      p.j2:4: not in the problem; it would be written by (ready {{ m.name }})
        line 3: query('lab.machines') asks {} in lab.machines: 1 document
        line 3: only if m.state == 'up'
      (ready a): false in the initial state
        no action makes it true; it has to hold in the initial state
    ------- stderr -------
    [exit code: 1]
    ");
    assert_run!(lab.rmem(&["gen-problem", "-t", "p.j2", "--explain", "(ready a)"]), @r"
    ------- stderr -------
    error: `(ready a)` is not in the problem
    p.j2:4: would be written by (ready {{ m.name }})
      line 3: query('lab.machines') asks {} in lab.machines: 1 document
      line 3: only if m.state == 'up'
    [exit code: 1]
    ");
    let json = lab.rmem(&["plan", "check", "last", "--format", "json"]).exits(1).stdout;
    let verdict: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(verdict["sources"][0]["reasons"][1], "line 3: only if m.state == 'up'");
}

const DRIVING: &str = "(define (domain d) (:requirements :typing :fluents :durative-actions) (:types r p)
  (:predicates (at ?r - r ?p - p) (road ?a ?b - p)) (:functions (battery ?r - r) (seconds ?a ?b - p))
  (:durative-action drive :parameters (?r - r ?a ?b - p) :duration (= ?duration (seconds ?a ?b))
    :condition (and (at start (at ?r ?a)) (at start (>= (battery ?r) (seconds ?a ?b))) (over all (road ?a ?b)))
    :effect (and (at start (not (at ?r ?a))) (at start (decrease (battery ?r) (seconds ?a ?b))) (at end (at ?r ?b)))))";
const ROADS: &str = "(define (problem p) (:domain d) (:objects R1 - r A B C - p)
 (:init
{% for r in query('lab.r', {'kind': 'robot'}) %}
  (at {{ r.name }} {{ r.at }})
  (= (battery {{ r.name }}) {{ r.battery }})
{% endfor %}
{% for w in query('lab.r', {'kind': 'road'}) %}
  (road {{ w.a }} {{ w.b }}) {% set jam = find_one('lab.r', {'kind': 'jam', 'a': w.a}) %}(= (seconds {{ w.a }} {{ w.b }}) {{ jam.s if jam else w.s }})
{% endfor %})
 (:goal (at R1 C)))";

/// A robot that plans to drive from A over B to C.
fn driving() -> Lab {
    let lab = Lab::new();
    lab.write("d.pddl", DRIVING);
    lab.write("p.j2", ROADS);
    let documents = [
        "{_id: 1, kind: 'robot', name: 'R1', at: 'A', battery: 9}",
        "{_id: 2, kind: 'road', a: 'A', b: 'B', s: 4}",
        "{_id: 3, kind: 'road', a: 'B', b: 'C', s: 5}",
    ];
    lab.rmem(&[&["insert", "-q", "lab.r"], &documents[..]].concat()).success();
    lab.rmem(&["plan", "-q", "-d", "d.pddl", "-t", "p.j2"]).success();
    lab
}

#[test]
fn a_step_that_is_running_is_not_begun_again() {
    let lab = driving();
    lab.rmem(&["plan", "step", "last", "1", "--started"]).success();
    // The robot has left, and the battery was measured since.
    lab.rmem(&["update", "lab.r", "{_id: 1}", "{$set: {at: 'A', battery: 5}}"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r"
    [ID] holds: 2 of 2 steps are left
    ------- stderr -------
    [exit code: 0]
    ");
    // The road that it is on is closed.
    lab.rmem(&["delete", "lab.r", "{_id: 2}"]).success();
    let broken = lab.rmem(&["plan", "check", "last"]).exits(1).stdout;
    assert!(
        broken.contains("does not hold: step 1: (drive R1 A B) is not applicable: (road A B) is false"),
        "{broken}"
    );
}

#[test]
fn a_duration_that_differs_names_the_number_and_its_documents() {
    let lab = driving();
    lab.rmem(&["insert", "-q", "lab.r", "{_id: 7, kind: 'jam', a: 'B', s: 8}"]).success();
    let broken = lab.rmem(&["plan", "check", "last"]).exits(1).stdout;
    let lines: Vec<&str> = broken.lines().skip(1).take_while(|line| !line.contains("false in the")).collect();
    assert!(broken.contains("step 2: the duration of (drive R1 B C) is 5, it must be 8"), "{broken}");
    assert_eq!(lines[0], "  p.j2:8:93: (= (seconds B C) 8) is in the memory", "{broken}");
    assert_eq!(lines[1], "  document _id 7 of lab.r", "{broken}");
    assert!(!broken.contains("it would be written by"), "{broken}");
    let explained = lab.rmem(&["gen-problem", "-t", "p.j2", "-d", "d.pddl", "--explain", "(seconds B C)"]).success();
    assert!(explained.contains("{\"_id\":7,\"kind\":\"jam\""), "the number is from there: {explained}");
    assert!(!explained.contains("'robot'"), "{explained}");
    let explained = lab.rmem(&["gen-problem", "-t", "p.j2", "-d", "d.pddl", "--explain", "8"]).success();
    assert!(explained.starts_with("(= (seconds B C) 8): in the initial state"), "{explained}");
    assert_run!(lab.rmem(&["gen-problem", "-t", "p.j2", "-d", "d.pddl", "--explain", "77"]), @r"
    ------- stderr -------
    error: `77` is not in the problem
    [exit code: 1]
    ");
}

#[test]
fn a_text_where_a_number_has_to_be_is_shown_with_its_document() {
    let lab = driving();
    lab.rmem(&["update", "-q", "lab.r", "{_id: 1}", "{$set: {battery: 'voll'}}"]).success();
    assert_run!(lab.rmem(&["gen-problem", "-t", "p.j2", "-d", "d.pddl"]), @r"
    ------- stderr -------
    error: p.j2:5:29: expected a number, found `voll`
      |
    5 |   (= (battery {{ r.name }}) {{ r.battery }})
      |                             ^^^^^^^^^^^^^^^
      = hint: it became line 5 of the problem: (= (battery R1) voll)
      = hint: from document _id 1 of lab.r, which has a text there; store a number, or leave the document out
    [exit code: 3]
    ");
}

#[test]
fn a_file_that_was_changed_since_is_named_once() {
    let lab = driving();
    lab.write("p.j2", &ROADS.replace("(at R1 C)", "(at R1 B)"));
    for command in [&["plan", "check", "last"][..], &["plan", "rerun", "last", "--no-store"]] {
        let run = lab.rmem(command).exits(0).to_string();
        assert_eq!(run.matches("warning: p.j2 was changed since").count(), 1, "{run}");
    }
}

#[test]
fn a_text_where_a_number_has_to_be_is_an_error_of_the_input() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :fluents) (:predicates (done)) (:functions (fuel))
         (:action go :parameters () :precondition (> (fuel) 1) :effect (done)))",
    );
    lab.write(
        "p.j2",
        "(define (problem p) (:domain d)\n (:init\n{% for tank in query('lab.tanks') %}\n(= (fuel) {{ tank.fuel }})\n{% endfor %})\n (:goal (done)))",
    );
    lab.rmem(&["insert", "lab.tanks", "{_id: 1, fuel: 3}"]).success();
    lab.rmem(&["plan", "-q", "-d", "d.pddl", "-t", "p.j2"]).success();
    lab.rmem(&["update", "lab.tanks", "{_id: 1}", "{$set: {fuel: 'much'}}"]).success();
    let check = lab.rmem(&["plan", "check", "last"]).exits(3);
    assert_eq!(check.stdout, "");
    assert!(check.stderr.starts_with("error: p.j2:4:11: "), "{}", check.stderr);
}
