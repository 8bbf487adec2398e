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
