//! Several planners at once: who wins, who is ended, and what is said where nobody wins.

use std::path::Path;

use crate::lab::{Finished, Lab};

/// Planners that cannot be had from real ones: one that never ends, one whose plan is wrong, and one that is right only
/// after that one was wrong.
const PLANNERS: &str = "[planner.sleeper]\ncommand = [\"/bin/sh\", \"-c\", \"echo $$ > PID; exec sleep 100\"]\noutput = \"ff\"\n\
     [planner.liar]\ncommand = [\"/bin/sh\", \"-c\", \"echo '(light a)' > {plan}; echo '; cost = 1 (unit cost)' >> {plan}; touch LIED\"]\noutput = \"downward\"\n\
     [planner.late]\ncommand = [\"/bin/sh\", \"-c\", \"until [ -e LIED ]; do sleep 0.05; done; sleep 1; exec RMEM ff -o {domain} -f {problem}\"]\noutput = \"ff\"\n\
     [planner.absent]\ncommand = [\"/nonexistent/planner\"]\noutput = \"ff\"\n\
     [planner.quitter]\ncommand = [\"/bin/sh\", \"-c\", \"echo 'search cap reached!'\"]\noutput = \"ff\"\n";

/// Runs planners against each other on a task of the fixtures.
fn race(lab: &Lab, task: &str, planners: &[&str], more: &[&str]) -> Finished {
    let pid = lab.path().join("sleeper.pid").display().to_string();
    let lied = lab.path().join("lied").display().to_string();
    let rmem = crate::lab::rmem().display().to_string();
    lab.write("rmem.toml", &PLANNERS.replace("PID", &pid).replace("LIED", &lied).replace("RMEM", &rmem));
    let (domain, problem) =
        (format!("fixtures/tasks/{task}/domain.pddl"), format!("fixtures/tasks/{task}/problem.pddl"));
    let mut words = vec!["plan", "-d", &domain, "-p", &problem, "--no-store"];
    planners.iter().for_each(|name| words.extend(["--planner", name]));
    lab.rmem(&[&words[..], more].concat())
}

/// The row of a planner in the table on stderr.
fn row<'r>(run: &'r Finished, planner: &str) -> &'r str {
    let mut rows = run.stderr.lines().filter_map(|line| line.trim_start().strip_prefix(planner));
    rows.next_back().unwrap_or_else(|| panic!("no row of {planner}: {run}"))
}

#[test]
fn the_first_right_plan_wins_and_the_others_are_ended() {
    let lab = Lab::new();
    let run = race(&lab, "solvable", &["sleeper", "builtin"], &[]).exits(0);
    assert!(run.stdout.starts_with('('), "{run}");
    assert!(row(&run, "builtin").contains("plan ") && row(&run, "builtin").ends_with("wins"), "{run}");
    assert!(row(&run, "sleeper").contains("ended"), "{run}");
    if let Ok(pid) = std::fs::read_to_string(lab.path().join("sleeper.pid")) {
        assert!(!Path::new("/proc").join(pid.trim()).exists(), "the sleeper is still there");
    }
}

#[test]
fn a_wrong_plan_does_not_win() {
    let run = race(&Lab::new(), "solvable", &["liar", "late"], &[]).exits(0);
    assert!(row(&run, "liar").contains("failed"), "{run}");
    assert!(row(&run, "late").ends_with("wins"), "{run}");
}

#[test]
fn a_proof_ends_the_race() {
    let run = race(&Lab::new(), "unreachable", &["sleeper", "builtin"], &[]).exits(11);
    assert!(row(&run, "sleeper").contains("ended") && row(&run, "builtin").contains("unsolvable"), "{run}");
}

#[test]
fn who_cannot_take_part_keeps_nobody_from_winning() {
    let run = race(&Lab::new(), "numeric", &["fast-downward", "absent", "builtin"], &[]).exits(0);
    assert!(row(&run, "fast-downward").contains("unsupported"), "{run}");
    assert!(row(&run, "absent").contains("not-found"), "{run}");
}

#[test]
fn where_nobody_wins_the_code_is_the_most_telling_one() {
    let lab = Lab::new();
    race(&lab, "solvable", &["absent", "liar"], &[]).exits(32);
    race(&lab, "solvable", &["liar", "quitter", "absent"], &[]).exits(12);
    race(&lab, "solvable", &["quitter", "sleeper"], &["--timeout", "300ms"]).exits(23);
}

#[test]
fn one_planner_makes_no_table() {
    let run = race(&Lab::new(), "solvable", &["builtin"], &[]).exits(0);
    assert!(!run.stderr.contains("wins"), "{run}");
}
