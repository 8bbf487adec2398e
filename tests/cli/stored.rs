//! plan list and the other commands about stored plans.

use crate::lab::{Finished, Lab};

const TASK: [&str; 8] = [
    "--load",
    "fixtures/blocksworld.json",
    "--domain",
    "domains/blocksworld/domain.pddl",
    "--template",
    "templates/blocksworld/problem.pddl.j2",
    "--goal",
    "(and (on A B) (on B C))",
];

fn plan(lab: &Lab, more: &[&str]) -> Finished {
    lab.rmem(&[&["plan"], &TASK[..], more].concat())
}

#[test]
fn a_list_has_the_newest_plan_first() {
    let lab = Lab::new();
    plan(&lab, &[]).success();
    lab.rmem(&[&["plan"], &TASK[2..6], &["--goal", "(on C A)"]].concat()).success();
    let list = lab.rmem(&["plan", "list"]).success();
    let lines: Vec<&str> = list.lines().collect();
    assert!(lines.len() == 2 && lines[0].contains("(on C A)") && lines[1].contains("(on B C)"), "{list}");
    assert_eq!(lab.rmem(&["plan", "list", "--limit", "1"]).success().lines().next(), Some(lines[0]));
}

#[test]
fn a_plan_command_takes_no_options_of_planning() {
    let lab = Lab::new();
    lab.rmem(&["plan"]).exits(2);
    lab.rmem(&["plan", "--goal", "(a)"]).exits(2);
    let run = lab.rmem(&["plan", "--domain", "domains/blocksworld/domain.pddl", "list"]).exits(2);
    assert!(run.stderr.contains("rmem plan --domain"), "{run}");
    lab.rmem(&["plan", "--memory", "mem:", "list"]).success();
}
