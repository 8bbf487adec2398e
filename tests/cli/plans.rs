//! plan, ff, validate: the whole line, its documents, its exit codes.

use crate::lab::{Lab, TASK, plan};

#[test]
fn from_memory_to_plan_to_memory() {
    let lab = Lab::new();
    let text = plan(&lab, &[]).success();
    assert!(text.lines().next().unwrap().starts_with('('), "{text}");
    assert!(text.lines().last().unwrap().starts_with("; cost = "), "{text}");
    let stored = lab.rmem(&["query", "robmem.plans", "{plan: 'success'}", "--fields", "{_id: 0}"]).success();
    let document: serde_json::Value = serde_json::from_str(stored.trim()).unwrap();
    assert_eq!(document["plan"], "success");
    let steps = text.lines().filter(|line| line.starts_with('(')).count();
    assert!(document.get(steps.to_string()).is_some() && document.get((steps + 1).to_string()).is_none(), "{stored}");
    assert!(document["1"]["action"].is_string(), "{stored}");
}

#[test]
fn the_plan_speaks_the_memorys_spelling() {
    let lab = Lab::new();
    let text = plan(&lab, &[]).success();
    assert!(text.contains(" A") && text.contains(" B"), "{text}");
    let document = plan(&lab, &["--format", "json"]).success();
    let document: serde_json::Value = serde_json::from_str(&document).unwrap();
    let values = document["steps"][0]["list"].as_array().unwrap();
    let values: Vec<&str> = values.iter().filter_map(|value| value.as_str()).collect();
    assert!(values.iter().all(|value| ["A", "B", "C", "D"].contains(value)), "{values:?}");
}

#[test]
fn lineage_says_where_the_plan_came_from() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    let stored = lab.rmem(&["query", "robmem.plans", "--meta"]).success();
    let document: serde_json::Value = serde_json::from_str(stored.trim()).unwrap();
    let lineage = &document["_robmem_info"]["lineage"];
    for key in ["domain", "problem", "template", "goal", "queries", "planner", "version", "outcome", "length", "times"]
    {
        assert!(!lineage[key].is_null(), "{key} is missing: {stored}");
    }
}

#[test]
fn fawkes_layout_is_an_array_of_actions() {
    let lab = Lab::new();
    plan(&lab, &["--layout", "fawkes"]).success();
    let stored = lab.rmem(&["query", "robmem.plans", "{plan: 1}"]).success();
    let document: serde_json::Value = serde_json::from_str(stored.trim()).unwrap();
    assert!(document["actions"][0]["name"].is_string() && document["actions"][0]["args"].is_array(), "{stored}");
}

#[test]
fn no_store_stores_nothing_and_into_says_where() {
    let lab = Lab::new();
    plan(&lab, &["--no-store"]).success();
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "0\n");
    plan(&lab, &["--into", "lab.plans"]).success();
    assert_eq!(lab.rmem(&["count", "lab.plans"]).success(), "1\n");
}

#[test]
fn a_pipeline_plans_what_was_generated() {
    let lab = Lab::new();
    let line = "rmem gen-problem --load fixtures/blocksworld.json --template templates/blocksworld/problem.pddl.j2 \
                --goal '(and (on A B) (on B C))' | rmem plan --domain domains/blocksworld/domain.pddl --problem -";
    assert_eq!(lab.shell(line).success(), plan(&lab, &["--no-store"]).success());
}

#[test]
fn every_printed_format_has_the_plan() {
    let lab = Lab::new();
    for (format, mark) in [
        ("text", "; cost ="),
        ("json", "\"outcome\":\"success\""),
        ("document", "\"plan\""),
        ("clips", "(plan-action "),
        ("ff", "step    0: "),
        ("dot", "digraph"),
    ] {
        let text = plan(&lab, &["--no-store", "--format", format]).success();
        assert!(text.contains(mark), "{format}: {text}");
    }
}

#[test]
fn a_goal_that_holds_needs_no_plan() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:predicates (p) (q)) (:action a :parameters () :precondition (p) :effect (q)))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init (p)) (:goal (p)))");
    let run = lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]).exits(0);
    assert!(run.stdout.starts_with("; cost = 0"), "{run}");
    assert_eq!(lab.rmem(&["query", "robmem.plans", "--fields", "{_id: 0}"]).success(), "{\"plan\":\"success\"}\n");
}

#[test]
fn no_plan_is_11_where_it_is_proven_and_stored_as_a_failure() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:predicates (p) (q)) (:action a :parameters () :precondition (q) :effect (q)))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init (p)) (:goal (q)))");
    lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]).exits(11);
    let stored = lab.rmem(&["query", "robmem.plans", "--fields", "{_id: 0}"]).success();
    assert!(stored.starts_with("{\"plan\":\"fail\",\"outcome\":\"unsolvable\""), "{stored}");
}

#[test]
fn why_there_is_no_plan_is_said_and_stored() {
    let lab = Lab::new();
    let task = ["-d", "fixtures/tasks/unreachable/domain.pddl", "-p", "fixtures/tasks/unreachable/problem.pddl"];
    let run = lab.rmem(&[&["plan"], &task[..]].concat()).exits(11);
    assert!(run.stderr.contains("why: the goal asks for (lit), which can never hold"), "{run}");
    let stored = lab.rmem(&["query", "robmem.plans", "--meta"]).success();
    let document: serde_json::Value = serde_json::from_str(stored.trim()).unwrap();
    let first = &document["_robmem_info"]["lineage"]["why"]["unreachable"][0];
    assert_eq!((&first["condition"], &first["goal"]), (&"(lit)".into(), &true.into()), "{stored}");
    assert!(first["achievers"][0]["missing"][0].is_string(), "{stored}");
}

#[test]
fn a_planner_that_is_not_there_is_127() {
    let run = plan(&Lab::new().env("PATH", "/nonexistent"), &["--planner", "ff"]).exits(127);
    assert!(run.stderr.contains("ff"), "{run}");
}

#[test]
fn an_unknown_planner_is_2_and_names_the_known_ones() {
    let run = plan(&Lab::new(), &["--planner", "nosuch"]).exits(2);
    assert!(run.stderr.contains("builtin") && run.stderr.contains("fast-downward"), "{run}");
}

#[test]
fn configured_planners_run_under_limits() {
    let lab = Lab::new();
    lab.write(
        "rmem.toml",
        "[planner.spammer]\ncommand = [\"yes\", \"step\"]\noutput = \"ff\"\n\
         [planner.sleeper]\ncommand = [\"/bin/sh\", \"-c\", \"sleep 100\"]\noutput = \"ff\"\n\
         [planner.crasher]\ncommand = [\"/bin/sh\", \"-c\", \"echo broken >&2; kill -SEGV $$\"]\noutput = \"ff\"\n\
         [planner.liar]\ncommand = [\"/bin/sh\", \"-c\", \"echo '(pickup A)' > {plan}; echo '; cost = 1 (unit cost)' >> {plan}\"]\noutput = \"downward\"\n",
    );
    plan(&lab, &["--planner", "sleeper", "--timeout", "300ms"]).exits(23);
    let run = plan(&lab, &["--planner", "crasher"]).exits(32);
    assert!(run.stderr.contains("broken"), "{run}");
    plan(&lab, &["--planner", "liar"]).exits(32);
    let run = plan(&lab, &["--planner", "spammer"]).exits(32);
    assert!(run.stderr.contains("printed more than"), "{run}");
}

#[test]
fn what_a_planner_cannot_do_is_34_before_it_runs() {
    let lab = Lab::new();
    lab.write("rmem.toml", "");
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :fluents) (:predicates (q)) (:functions (fuel))\n\
         (:action a :parameters () :precondition (>= (fuel) 1) :effect (and (q) (decrease (fuel) 1))))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init (= (fuel) 3)) (:goal (q)))");
    let run = lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--planner", "fast-downward"]).exits(34);
    assert!(run.stderr.contains("d.pddl:"), "{run}");
    lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]).exits(0);
}

#[test]
fn the_builtin_planner_speaks_ff() {
    let lab = Lab::new();
    lab.write("p.pddl", &problem(&lab));
    let text = lab.rmem(&["ff", "-o", "domains/blocksworld/domain.pddl", "-f", "p.pddl"]).success();
    assert!(text.contains("ff: found legal plan as follows") && text.contains("step    0: "), "{text}");
}

fn problem(lab: &Lab) -> String {
    let args = [
        "gen-problem",
        "--load",
        "fixtures/blocksworld.json",
        "--template",
        "templates/blocksworld/problem.pddl.j2",
        "--goal",
        "(on A B)",
    ];
    lab.rmem(&args).success()
}

#[test]
fn validate_says_yes_or_which_step_breaks() {
    let lab = Lab::new();
    lab.write("p.pddl", &problem(&lab));
    let domain = "domains/blocksworld/domain.pddl";
    lab.rmem(&["validate", domain]).success();
    lab.rmem(&["validate", domain, "p.pddl"]).success();
    let found = lab.rmem(&["plan", "-d", domain, "-p", "p.pddl", "--no-store"]).success();
    lab.write("good.plan", &found);
    lab.rmem(&["validate", domain, "p.pddl", "good.plan"]).success();
    let mut lines: Vec<&str> = found.lines().filter(|line| line.starts_with('(')).collect();
    lines.remove(0);
    lab.write("bad.plan", &lines.join("\n"));
    let run = lab.rmem(&["validate", domain, "p.pddl", "bad.plan"]).exits(1);
    assert!(run.stdout.contains("step 1"), "{run}");
    lab.write("cut.plan", "(pickup A");
    let run = lab.rmem(&["validate", domain, "p.pddl", "cut.plan"]).exits(3);
    assert!(run.stderr.contains("cut.plan:1:"), "{run}");
}

/// The table of `fixtures/tasks/README.md`: task, and the exit codes that the built-in planner may end with.
fn tasks() -> Vec<(String, Vec<i32>)> {
    let table = std::fs::read_to_string(crate::lab::root().join("fixtures/tasks/README.md")).unwrap();
    let rows = table.lines().filter(|line| line.starts_with("| `"));
    rows.map(|row| {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        (cells[1].trim_matches('`').to_owned(), cells[5].split(" or ").map(|code| code.parse().unwrap()).collect())
    })
    .collect()
}

#[test]
fn every_kind_of_task_ends_with_its_exit_code() {
    let lab = Lab::new();
    let tasks = tasks();
    assert!(tasks.len() >= 13);
    for (task, codes) in tasks {
        let folder = format!("fixtures/tasks/{task}");
        let (domain, problem) = (format!("{folder}/domain.pddl"), format!("{folder}/problem.pddl"));
        // Tasks without end are cut off early; the others get all the time a busy machine may need.
        let timeout = if codes.iter().any(|code| [22, 23].contains(code)) { "1s" } else { "60s" };
        let limits = ["--timeout", timeout, "--memory-limit", "2G", "--no-store"];
        let run = lab.rmem(&[&["plan", "-d", &domain, "-p", &problem], &limits[..]].concat());
        assert!(codes.contains(&run.code), "{task}: {codes:?}\n{run}");
        if run.code == 34 {
            assert!(run.stderr.contains(&format!("{domain}:")), "{task}: {run}");
        }
    }
}

#[test]
fn a_limit_of_memory_is_22() {
    let (domain, problem) = ("fixtures/tasks/explosion/domain.pddl", "fixtures/tasks/explosion/problem.pddl");
    let args = ["plan", "-d", domain, "-p", problem, "--memory-limit", "100M", "--timeout", "60s", "--no-store"];
    let run = Lab::new().rmem(&args).exits(22);
    assert!(run.stderr.contains("memory"), "{run}");
}

#[test]
fn a_limit_of_memory_is_the_same_one_each_time() {
    let lab = Lab::new();
    let folder = "fixtures/tasks/durative-numeric";
    let (domain, problem) = (format!("{folder}/domain.pddl"), format!("{folder}/problem.pddl"));
    for limit in ["120M", "160M", "200M", "240M"] {
        let args = ["plan", "-d", &domain, "-p", &problem, "--memory-limit", limit, "--timeout", "60s", "--no-store"];
        let codes: Vec<i32> = (0..6).map(|_| lab.rmem(&args).code).collect();
        assert!(codes.iter().all(|code| code == &codes[0]), "{limit}: {codes:?}");
    }
    lab.rmem(&["plan", "-d", &domain, "-p", &problem, "--memory-limit", "400M", "--no-store"]).success();
}

/// A plan whose planner has started and sleeps; its temporary files go to `tmp` in the lab.
fn planning() -> (Lab, std::process::Child) {
    let lab = Lab::new();
    lab.write("rmem.toml", "[planner.sleeper]\ncommand = [\"sleep\", \"98.76\"]\noutput = \"ff\"\n");
    std::fs::create_dir(lab.path().join("tmp")).unwrap();
    let mut command = std::process::Command::new(crate::lab::rmem());
    command.args([&["plan"], &TASK[..], &["--planner", "sleeper"]].concat());
    lab.isolate(&mut command);
    command.env("TMPDIR", lab.path().join("tmp")).stderr(std::process::Stdio::null());
    let mut child = command.spawn().unwrap();
    while sleepers(&lab) == 0 {
        assert!(child.try_wait().unwrap().is_none(), "it ended before its planner started");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    (lab, child)
}

#[test]
fn an_interruption_is_130_and_leaves_nothing_behind() {
    let (lab, mut child) = planning();
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(sleepers(&lab), 0);
    assert_eq!(std::fs::read_dir(lab.path().join("tmp")).unwrap().count(), 0);
}

#[test]
fn a_killed_rmem_takes_its_planner_along() {
    let (lab, mut child) = planning();
    child.kill().unwrap();
    child.wait().unwrap();
    // The supervisor notices by itself; how soon is the machine's business.
    while sleepers(&lab) > 0 || std::fs::read_dir(lab.path().join("tmp")).unwrap().count() > 0 {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
}

#[test]
fn a_task_that_is_wrong_leaves_nothing_of_the_planner_that_waited_for_it() {
    let lab = Lab::new();
    let tmp = lab.path().join("tmp");
    std::fs::create_dir(&tmp).unwrap();
    let lab = lab.env("TMPDIR", &tmp.display().to_string());
    lab.write("d.pddl", "(define (domain d) (:predicates (p)) (:action a :parameters () :effect (p)))");
    for problem in ["(define (problem n) (:domain d) (:init) (:goal (q)))", "(define"] {
        lab.write("p.pddl", problem);
        lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]).exits(3);
        assert_eq!(std::fs::read_dir(&tmp).unwrap().count(), 0, "{problem}");
    }
}

/// How many planners of this lab are running: their environment has the lab's folder in it.
fn sleepers(lab: &Lab) -> usize {
    let folder = lab.path().display().to_string();
    let processes = std::fs::read_dir("/proc").unwrap().flatten().map(|entry| entry.path());
    let of = |path: &std::path::Path, name: &str| {
        String::from_utf8_lossy(&std::fs::read(path.join(name)).unwrap_or_default()).into_owned()
    };
    processes.filter(|path| of(path, "cmdline").starts_with("sleep\0") && of(path, "environ").contains(&folder)).count()
}
