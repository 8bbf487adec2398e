//! validate.

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
    the plan is invalid: step 1: (unstack D A) cannot be taken: (hand-empty) is false
      (hand-empty): not so from the beginning
        (putdown B) would make it so, and can be taken there
        (stack B C) would make it so, and can be taken there
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
