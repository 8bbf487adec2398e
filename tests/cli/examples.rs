//! The examples of executives, with a world that changes under them.

use crate::lab::{Finished, Lab};

/// The examples of executives; the second needs Python.
const EXECUTIVES: [&str; 2] = ["sh examples/shell/executive.sh", "python3 examples/python/executive.py"];

/// The executives that can run here.
fn executives() -> impl Iterator<Item = &'static str> {
    let has_python = std::path::Path::new("/usr/bin/python3").is_file();
    EXECUTIVES.into_iter().filter(move |executive| has_python || !executive.starts_with("python3"))
}

/// Runs an executive on the blocks world; before its second action, `disturbance` happens.
fn run(lab: &Lab, executive: &str, disturbance: &str) -> Finished {
    lab.write(
        "hands.sh",
        &format!(
            "#!/bin/sh\nset -eu\necho x >>count\nif [ \"$(wc -l <count)\" -eq 2 ]; then\n{disturbance}\nfi\n\
             exec examples/shell/blocks.sh \"$@\"\n"
        ),
    );
    let line = format!(
        "chmod +x hands.sh && rmem count robmem.worldmodel --load fixtures/blocksworld.json >/dev/null && \
         {executive} domains/blocksworld/domain.pddl templates/blocksworld/problem.pddl.j2 \
         '(and (on A B) (on B C))' ./hands.sh"
    );
    lab.shell(&line)
}

/// The goal's two facts are in the memory.
fn is_reached(lab: &Lab) -> bool {
    let filter = "{$or: [{object_top: 'A', object_bottom: 'B'}, {object_top: 'B', object_bottom: 'C'}]}";
    lab.rmem(&["count", "robmem.worldmodel", filter]).success() == "2\n"
}

#[test]
fn an_executive_takes_the_steps_of_its_plan_one_by_one() {
    for executive in executives() {
        let lab = Lab::new();
        let text = run(&lab, executive, ":").success();
        assert_eq!(text, "plan 1\ndid stack B C\ndid unstack D A\ndid putdown D\ndid pickup A\ndid stack A B\n");
        assert!(is_reached(&lab));
        let plan = lab.rmem(&["plan", "show", "last"]).success();
        assert_eq!(plan.matches("; done").count(), 5, "{plan}");
    }
}

#[test]
fn an_executive_takes_plans_with_times_and_names_with_blanks() {
    for executive in executives() {
        let lab = Lab::new();
        lab.write(
            "d.pddl",
            "(define (domain d) (:requirements :durative-actions :typing) (:types box)\n\
             (:predicates (on ?b - box) (off ?b - box))\n\
             (:durative-action lift :parameters (?b - box) :duration (= ?duration 5)\n\
             :condition (at start (on ?b)) :effect (and (at start (not (on ?b))) (at end (off ?b)))))\n",
        );
        lab.write(
            "t.j2",
            "(define (problem p) (:domain d)\n\
             (:objects {% for b in query('a.boxes') %}{{ b.name }} {% endfor %}- box)\n\
             (:init {% for b in query('a.boxes') %}({{ b.state }} {{ b.name }}) {% endfor %})\n\
             (:goal {{ goal }}))\n",
        );
        lab.write(
            "act.sh",
            "#!/bin/sh\nset -eu\necho \"$#: $2\"\n\
             rmem update -q a.boxes \"{name: '$2'}\" \"{\\$set: {state: 'off'}}\" >/dev/null\n",
        );
        lab.rmem(&["insert", "a.boxes", "{name: \"Box (1): $HOME\", state: 'on'}"]).success();
        let text =
            lab.shell(&format!("chmod +x act.sh && {executive} d.pddl t.j2 '(off \"Box (1): $HOME\")' ./act.sh"));
        assert_eq!(text.success(), "plan 1\n2: Box (1): $HOME\ndid lift Box (1): $HOME\n", "{executive}");
        assert_eq!(lab.rmem(&["count", "a.boxes", "{state: 'off'}"]).success(), "1\n");
    }
}

#[test]
fn a_name_with_a_line_break_is_no_word_of_a_line_for_a_shell() {
    let lab = Lab::new();
    let domain = "(define (domain d) (:types box) (:predicates (on ?b - box) (off ?b - box))\n\
                  (:action lift :parameters (?b - box) :precondition (on ?b) :effect (and (not (on ?b)) (off ?b))))\n";
    lab.write("d.pddl", domain);
    lab.write(
        "t.j2",
        "{% set b = find_one('a.boxes').name %}(define (problem p) (:domain d) (:objects {{ b }} - box)\n\
         (:init (on {{ b }})) (:goal (off {{ b }})))\n",
    );
    lab.rmem(&["insert", "a.boxes", "{name: 'x\\n1; touch here #'}"]).success();
    lab.rmem(&["plan", "-q", "-d", "d.pddl", "-t", "t.j2"]).success();
    let shown = lab.rmem(&["plan", "show", "last", "--format", "shell"]).exits(3);
    assert!(shown.stdout.is_empty() && shown.stderr.contains("has a line break in it"), "{shown}");
}

#[test]
fn an_executive_notices_that_the_world_changed_and_plans_again() {
    for executive in executives() {
        let lab = Lab::new();
        // While D is taken from A, B is taken from C and put on the table.
        let disturbance = "rmem delete robmem.worldmodel \"{object_top: 'B'}\" >/dev/null\n\
                       rmem insert -q robmem.worldmodel \"{relation: 'on-table', object: 'B'}\" \
                       \"{relation: 'clear', object: 'C'}\" >/dev/null";
        let text = run(&lab, executive, disturbance).success();
        assert!(text.starts_with("plan 1\ndid stack B C\ndid unstack D A\n"), "{text}");
        assert_eq!(text.matches("plan ").count(), 2, "{text}");
        assert!(text.matches("did stack B C").count() == 2 && text.ends_with("did stack A B\n"), "{text}");
        assert!(is_reached(&lab));
    }
}

#[test]
fn an_executive_plans_again_after_an_action_that_failed() {
    for executive in executives() {
        let lab = Lab::new();
        let text = run(&lab, executive, "exit 1").success();
        assert!(text.starts_with("plan 1\ndid stack B C\nfailed unstack D A\nplan 2\ndid unstack D A\n"), "{text}");
        assert!(is_reached(&lab));
        let failed = lab.rmem(&["count", "robmem.plans", "{'2._status': 'failed'}"]).success();
        assert_eq!(failed, "1\n");
    }
}

#[test]
fn an_executive_ends_with_the_code_of_the_planning_that_failed() {
    for executive in executives() {
        let lab = Lab::new();
        // A block that is nowhere any more cannot be stacked.
        let run = run(
            &lab,
            executive,
            "rmem delete robmem.worldmodel \"{\\$or: [{object: 'A'}, {object_bottom: 'A'}]}\" --many >/dev/null; exit 1",
        );
        assert_eq!(run.code, 3, "{run}");
    }
}
