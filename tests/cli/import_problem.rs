//! import-problem.

use crate::lab::{Lab, assert_run};

#[test]
fn a_problem_becomes_documents_and_a_template_makes_it_again() {
    let lab = Lab::new();
    let problem = "fixtures/tasks/numeric/problem.pddl";
    lab.rmem(&[
        "import-problem",
        problem,
        "--into",
        "lab.task",
        "--template",
        "t.j2",
        "-d",
        "fixtures/tasks/numeric/domain.pddl",
    ])
    .success();
    let objects = lab.rmem(&["count", "lab.task", "{relation: 'domain-object'}"]).success();
    assert_ne!(objects, "0\n");
    let task = ["-d", "fixtures/tasks/numeric/domain.pddl"];
    let from_file = lab.rmem(&[&["plan", "--no-store", "-p", problem], &task[..]].concat()).success();
    assert_eq!(lab.rmem(&[&["plan", "--no-store", "-t", "t.j2"], &task[..]].concat()).success(), from_file);
    assert_run!(lab.rmem(&["import-problem", problem, "--into", "lab.task"]), @r"
    ------- stderr -------
    error: lab.task has 13 documents of an imported problem; expected another collection, or --replace
    [exit code: 3]
    ");
    let all = lab.rmem(&["count", "lab.task"]).success();
    lab.rmem(&["import-problem", problem, "--into", "lab.task", "--replace"]).success();
    assert_eq!(lab.rmem(&["count", "lab.task"]).success(), all);
}
