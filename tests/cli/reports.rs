//! What an executive reads of a plan, and how it says what it did.

use serde_json::{Value, json};

use crate::lab::{Lab, plan};

fn parsed(text: &str) -> Value {
    serde_json::from_str(text.trim()).unwrap()
}

#[test]
fn a_report_is_printed_for_a_plan_and_for_a_failure_also_quietly() {
    let lab = Lab::new();
    let found = parsed(&plan(&lab, &["-q", "--format", "json"]).success());
    assert_eq!((&found["outcome"], &found["exit"], &found["cost"]), (&json!("success"), &json!(0), &json!(5)));
    let step = json!({"index": 1, "action": "stack", "args": {"x": "B", "y": "C"}, "list": ["B", "C"],
        "start": null, "duration": null, "status": "open"});
    assert_eq!(found["steps"][0], step);
    assert_eq!((&found["sections"][0]["line"], &found["namespace"]), (&json!(7), &json!("robmem.plans")));
    let id = found["id"].as_str().unwrap();
    assert_eq!(parsed(&lab.rmem(&["plan", "show", id, "--format", "json"]).success()), found);
    let none = unreachable(&lab);
    assert_eq!((&none["outcome"], &none["exit"], &none["steps"]), (&json!("unsolvable"), &json!(11), &json!([])));
}

/// The report of a task whose goal cannot be reached.
fn unreachable(lab: &Lab) -> Value {
    let task = ["-d", "fixtures/tasks/unreachable/domain.pddl", "-p", "fixtures/tasks/unreachable/problem.pddl"];
    parsed(&lab.rmem(&[&["plan", "-q", "--format", "json"], &task[..]].concat()).exits(11).stdout)
}

#[test]
fn a_plan_with_a_failed_step_does_not_hold_until_the_step_is_begun_again() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    lab.rmem(&["plan", "step", "last", "1", "--failed"]).success();
    let check = lab.rmem(&["plan", "check", "last"]).exits(1);
    assert!(check.stdout.contains("does not hold: step 1: it failed, and was not begun again"), "{check}");
    lab.rmem(&["plan", "step", "last", "1", "--started"]).success();
    lab.rmem(&["plan", "check", "last"]).success();
}

#[test]
fn a_step_is_done_before_an_earlier_one_only_where_that_is_meant() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    let refused = lab.rmem(&["plan", "step", "last", "3", "--done"]).exits(2);
    assert!(refused.stderr.contains("step 1 is open") && refused.stderr.contains("--out-of-order"), "{refused}");
    lab.rmem(&["plan", "step", "last", "3", "--done", "--out-of-order"]).success();
}

#[test]
fn names_are_written_as_the_memory_has_them() {
    let lab = Lab::new().env("RMEM_MEMORY", "file:m.rmem");
    lab.write(
        "domain.pddl",
        "(define (domain lamps) (:predicates (wick ?x) (lit ?x))
         (:action light :parameters (?x) :precondition (wick ?x) :effect (lit ?x)))",
    );
    lab.write(
        "p.j2",
        "(define (problem p) (:domain lamps) (:objects {% for l in query('a.b') %}{{ l.name }} {% endfor %})
         (:init {% for l in query('a.b') %}(wick {{ l.name }}) {% endfor %}) (:goal {{ goal }}))",
    );
    lab.rmem(&["insert", "a.b", "{name: 'box #18'}", "{name: 'box#17'}"]).success();
    let goal = "(and (lit \"box #18\") (lit box#17))";
    let text = lab.rmem(&["plan", "-d", "domain.pddl", "-t", "p.j2", "--goal", goal]).success();
    assert!(text.contains("(light \"box #18\")\n") && text.contains("(light box#17)\n"), "{text}");
    assert!(lab.rmem(&["plan", "list"]).success().contains("lit box#17"));
    // What was printed is read again.
    lab.write("plan.txt", &text);
    lab.rmem(&["gen-problem", "-t", "p.j2", "--goal", goal, "-o", "p.pddl"]).success();
    let files = ["validate", "domain.pddl", "p.pddl", "plan.txt", "plan.txt"];
    assert_eq!(lab.rmem(&files).success(), "plan.txt: the plan is valid, value 2\n".repeat(2));
    let judged = parsed(&lab.rmem(&[&files[..4], &["--format", "json"]].concat()).success());
    assert_eq!((&judged["valid"], &judged["steps"]), (&json!(true), &json!(2)));
    let explained =
        lab.rmem(&["gen-problem", "-t", "p.j2", "--goal", goal, "--explain", "(wick \"box #18\")"]).success();
    assert!(explained.contains("p.j2:2:"), "{explained}");
}
