//! Planning inside programs of CLIPS does what `rmem plan` does.

use std::process::{Command, Stdio};

use rustix::process::{Pid, Signal};

use crate::lab::watch::{end, until};
use crate::lab::{Finished, Lab, assert_run, rmem};

/// Lamps that can be lit where they have a wick. The predicate `near` has more arguments than FF 2.3 has room for.
const DOMAIN: &str = "(define (domain lamps) (:requirements :strips)
  (:predicates (wick ?x) (lit ?x) (near ?a ?b ?c ?d ?e ?f))
  (:action light :parameters (?x) :precondition (wick ?x) :effect (lit ?x)))";

const PROBLEM: &str = "(define (problem p) (:domain lamps) (:objects a) (:init (wick a)) (:goal (lit a)))";

fn lab() -> Lab {
    let lab = Lab::new().env("RMEM_MEMORY", "file:m.rmem");
    lab.write("domain.pddl", DOMAIN);
    lab.write("problem.pddl", PROBLEM);
    lab
}

/// Runs a program that does these actions once.
#[track_caller]
fn run(lab: &Lab, actions: &str) -> Finished {
    lab.write("program.clp", &format!("(defrule go => {actions})"));
    lab.rmem(&["clips", "run", "program.clp"])
}

#[test]
fn a_search_that_is_interrupted_in_clips_is_not_stored_as_a_failed_plan() {
    let lab = lab();
    let begun = lab.path().join("begun").display().to_string();
    let command = format!("command = ['/bin/sh', '-c', 'touch {begun}; exec sleep 100']");
    lab.write("rmem.toml", &format!("[planner.slow]\n{command}\noutput = 'ff'\n"));
    lab.write("program.clp", "(defrule go => (rm-plan \"domain.pddl\" \"problem.pddl\" slow))");
    lab.rmem(&["insert", "lab.lamps", "{name: 'a'}"]).success();
    let mut command = Command::new(rmem());
    lab.isolate(command.args(["clips", "run", "program.clp"]).stdout(Stdio::null()).stderr(Stdio::null()));
    let mut running = command.spawn().unwrap();
    until("the planner runs", || lab.path().join("begun").exists());
    rustix::process::kill_process(Pid::from_child(&running), Signal::INT).unwrap();
    assert_eq!(end(&mut running), 130);
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "0\n");
    // The same planner, stopped by its own limit, is.
    assert_run!(run(&lab, "(printout t (rm-plan \"domain.pddl\" \"problem.pddl\" slow 1))"), @r"
    FALSE------- stderr -------
    [RMEM5] Function 'rm-plan': slow: the planner ran out of time: no plan within 1s
    [exit code: 0]
    ");
    assert_eq!(lab.rmem(&["count", "robmem.plans", "{plan: 'fail'}"]).success(), "1\n");
}

#[test]
fn a_present_day_ff_has_no_fixed_sizes_in_clips_either() {
    let plan = "(printout t (neq FALSE (rm-plan \"domain.pddl\" \"problem.pddl\" ff)))";
    let installed = |remark: &str| {
        let lab = lab();
        let script = format!("#!/bin/sh\n# {remark}\nexec {} ff \"$@\"\n", rmem().display());
        lab.write("bin/ff", &script);
        lab.shell("chmod +x bin/ff").success();
        let path = format!("{}:/usr/bin:/bin", lab.path().join("bin").display());
        lab.env("PATH", &path)
    };
    assert_eq!(run(&installed("ferroplan"), plan).success(), "TRUE");
    assert_run!(run(&installed("FF 2.3"), plan), @r"
    FALSE------- stderr -------
    [RMEM5] Function 'rm-plan': ff: the planner cannot handle the task: domain.pddl:2:36: the planner `ff` is built for at most 5 arguments; `near` has 6
      |
    2 |   (:predicates (wick ?x) (lit ?x) (near ?a ?b ?c ?d ?e ?f))
      |                                    ^^^^
      = hint: name another planner with --planner, or a larger build of this one in rmem.toml
    [exit code: 0]
    ");
}

#[test]
fn a_plan_that_was_not_wholly_checked_is_a_warning_in_clips_too() {
    let lab = lab();
    lab.write(
        "problem.pddl",
        &PROBLEM.replace("(:goal (lit a))", "(:goal (lit a)) (:constraints (sometime (always (lit a))))"),
    );
    let command = "command = [\"/bin/sh\", \"-c\", \"printf '(light a)\\\\n; cost = 1 (unit cost)\\\\n' > {plan}\"]";
    lab.write("rmem.toml", &format!("[planner.sure]\n{command}\noutput = \"downward\"\n"));
    assert_run!(lab.rmem(&["plan", "-d", "domain.pddl", "-p", "problem.pddl", "--planner", "sure"]), @r"
    (light a)
    ; cost = 1 (unit cost)
    ------- stderr -------
    warning: the plan was not wholly checked: the constraint (sometime (always (lit a))) is not simulated
    stored in robmem.plans as [ID]
    [exit code: 0]
    ");
    assert_run!(run(&lab, "(printout t (neq FALSE (rm-plan \"domain.pddl\" \"problem.pddl\" sure)))"), @r"
    TRUE------- stderr -------
    warning: the plan was not wholly checked: the constraint (sometime (always (lit a))) is not simulated
    [exit code: 0]
    ");
}

#[test]
fn a_failure_is_reported_in_the_memorys_names_in_clips_too() {
    let lab = lab();
    lab.rmem(&["insert", "lab.lamps", "{name: 'lamp #18'}"]).success();
    lab.write(
        "problem.pddl.j2",
        "(define (problem p) (:domain lamps)
  (:objects {% for lamp in query('lab.lamps') %}{{ lamp.name }} {% endfor %})
  (:init)
  (:goal (and {% for lamp in query('lab.lamps') %}(lit {{ lamp.name }}) {% endfor %})))",
    );
    let actions = "(bind ?p (rm-gen-problem \"problem.pddl.j2\")) (printout t (rm-plan \"domain.pddl\" ?p))";
    assert_run!(run(&lab, actions), @r#"
    FALSE------- stderr -------
    [RMEM5] Function 'rm-plan': builtin: proven: no plan exists: goal can be simplified to FALSE. No plan will solve it
    why: the goal asks for (lit "lamp #18"), which can never hold
           (light "lamp #18") would make it true, but needs (wick "lamp #18")
         and (wick "lamp #18"), which can never hold: no action makes it true
    never true, in the initial state or by an action: wick
    [exit code: 0]
    "#);
}
