//! compare: planners side by side, their scores, and going on after an interruption.

use crate::lab::{Lab, assert_run};

/// A planner that finds a plan with a useless step, one that finds none, and one that waits to be interrupted.
const PLANNERS: &str = "memory = 'file:robot.rmem'\n\
     [planner.quitter]\ncommand = [\"/bin/sh\", \"-c\", \"echo run >> LOG; echo 'search cap reached!'\"]\noutput = \"ff\"\n\
     [planner.sleeper]\ncommand = [\"/bin/sh\", \"-c\", \"touch LOG.asleep; exec sleep 100\"]\noutput = \"ff\"\n";

fn lab() -> Lab {
    let lab = Lab::new();
    lab.write("rmem.toml", &PLANNERS.replace("LOG", &lab.path().join("log").display().to_string()));
    for name in ["one", "two"] {
        let from = |file: &str| std::fs::read_to_string(crate::lab::root().join("fixtures/tasks/solvable").join(file));
        let problem = from("problem.pddl").unwrap();
        lab.write("tasks/lights/domain.pddl", &from("domain.pddl").unwrap());
        lab.write(&format!("tasks/lights/{name}.pddl"), &format!("; {name}\n{problem}"));
    }
    lab
}

fn runs(lab: &Lab) -> usize {
    std::fs::read_to_string(lab.path().join("log")).unwrap_or_default().lines().count()
}

#[test]
fn planners_are_run_on_tasks_and_scored() {
    let lab = lab();
    let both = ["--planner", "builtin", "--planner", "quitter"];
    let text = lab.rmem(&[&["compare", "tasks", "--format", "json"], &both[..]].concat()).success();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let short: Vec<String> = value["runs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|run| format!("{} {} {}", run["task"], run["planner"], run["outcome"]))
        .collect();
    assert_eq!(
        short,
        [
            r#""lights/one" "builtin" "success""#,
            r#""lights/one" "quitter" "gave-up""#,
            r#""lights/two" "builtin" "success""#,
            r#""lights/two" "quitter" "gave-up""#,
        ]
    );
    let run = &value["runs"][0];
    assert!(run["seconds"].as_f64().unwrap() > 0.0 && run["cost"] == run["steps"], "{run}");
    // Also of runs that are over before their processes are looked at.
    for run in value["runs"].as_array().unwrap() {
        assert!(run["cpu"].as_f64().unwrap() > 0.0 && run["memory"].as_i64().unwrap() > 100_000, "{run}");
    }
    let [best, worst] = [0, 1].map(|nth| value["scores"][nth].clone());
    assert_eq!((&best["solved"], &best["ipc_satisficing"], &best["coverage"]), (&2.into(), &2.0.into(), &1.0.into()));
    assert_eq!((&worst["solved"], &worst["par10"]), (&0.into(), &600.0.into()));
}

#[test]
fn a_plot_is_drawn_without_a_word_where_nothing_is_solved() {
    let lab = lab();
    let args = ["compare", "tasks", "--only", "one", "--planner", "quitter", "--plot", "none.svg"];
    assert_eq!(lab.rmem(&args).exits(0).stderr, "");
    assert!(std::fs::read_to_string(lab.path().join("none.svg")).unwrap().contains("quitter 0 of 1"));
}

#[test]
fn csv_has_the_runs_and_scores_apart() {
    let lab = lab();
    let csv = lab.rmem(&["compare", "tasks", "--format", "csv", "--only", "one"]).success();
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(
        (lines.len(), lines[0]),
        (2, "task,planner,outcome,seconds,cpu,memory,cost,makespan,steps,exit_code,message"),
        "{csv}"
    );
    assert!(lines[1].starts_with("lights/one,builtin,success,"), "{csv}");
    let scores = lab.rmem(&["compare", "tasks", "--format", "csv", "--scores"]).success();
    assert!(scores.starts_with("planner,tasks,solved,coverage,ipc_satisficing,ipc_agile,par10,memory\n"), "{scores}");
    let table = lab.rmem(&["compare", "tasks", "--format", "table"]).success();
    assert!(table.contains("lights/two") && table.contains("par10"), "{table}");
}

#[test]
fn files_and_stored_plans_are_tasks_too() {
    let lab = lab();
    let files = ["tasks/lights/domain.pddl", "tasks/lights/one.pddl", "tasks/lights/two.pddl"];
    let text = lab.rmem(&[&["compare", "-q"], &files[..]].concat()).success();
    assert_eq!(text.matches("\"outcome\":\"success\"").count(), 2, "{text}");
    lab.rmem(&["plan", "-d", files[0], "-p", files[1]]).success();
    lab.rmem(&["plan", "-d", files[0], "-p", files[1]]).success();
    let text = lab.rmem(&["compare", "--stored", "robmem.plans"]).success();
    assert_eq!(text.matches("\"outcome\":\"success\"").count(), 1, "the same task once: {text}");
}

#[test]
fn a_comparison_goes_on_where_it_was_interrupted() {
    let lab = lab();
    let first = ["compare", "tasks", "--only", "one", "--planner", "quitter"];
    lab.rmem(&first).success();
    assert_eq!(runs(&lab), 1);
    // Another task is run, the known one is not.
    let all = ["compare", "tasks", "--planner", "quitter"];
    let run = lab.rmem(&all).exits(0);
    assert_eq!(runs(&lab), 2);
    assert!(run.stderr.contains("1 of 2 runs were there already"), "{run}");
    assert_eq!(run.stdout.matches("gave-up").count(), 2, "{run}");
    lab.rmem(&[&all[..], &["--again"]].concat()).success();
    assert_eq!(runs(&lab), 4);
    // Another limit makes another run.
    lab.rmem(&[&all[..], &["--timeout", "61s"]].concat()).success();
    assert_eq!(runs(&lab), 6);
    // A task that has changed is run again.
    let text = lab.read("tasks/lights/one.pddl");
    lab.write("tasks/lights/one.pddl", &format!("; changed\n{text}"));
    lab.rmem(&all).success();
    assert_eq!(runs(&lab), 7);
}

#[test]
fn an_interruption_keeps_what_was_measured() {
    let lab = lab();
    // Once one run is over and stored, and the next one has begun.
    let line = "rmem compare tasks --planner quitter --planner sleeper & pid=$!; \
                is_so='[ -e log.asleep ] && [ \"$(rmem count robmem.comparisons)\" = 1 ]'; \
                timeout 60 bash -c \"until $is_so; do sleep 0.05; done\"; kill -INT $pid; wait $pid";
    let run = lab.shell(line).exits(130);
    assert!(run.stderr.contains("the same command goes on from here"), "{run}");
    assert_eq!(run.stdout.matches("\"task\"").count(), 1, "{run}");
    let kept = lab.rmem(&["count", "robmem.comparisons"]).success();
    assert_eq!(kept, "1\n");
}

#[test]
fn a_plot_shows_what_was_solved_when() {
    let lab = lab();
    lab.rmem(&["compare", "tasks", "--planner", "builtin", "--plot", "solved.svg"]).success();
    let svg = lab.read("solved.svg");
    assert!(svg.contains("Tasks solved: builtin 2 of 2") && svg.contains("time (s)"), "{svg}");
    lab.rmem(&["compare", "tasks", "--planner", "quitter", "--plot", "none.svg"]).success();
    assert!(!lab.read("none.svg").contains("NaN"));
}

#[test]
fn a_plot_is_svg_or_png() {
    assert_run!(lab().rmem(&["compare", "tasks", "--plot", "x.gif"]), @r"
    ------- stderr -------
    error: invalid value 'x.gif' for '--plot <FILE>': a picture is SVG or PNG; expected a name that ends in .svg or .png

    For more information, try '--help'.
    [exit code: 2]
    ");
}

#[test]
fn what_cannot_be_compared_is_named() {
    let lab = lab();
    let refused = |args: &[&str], code: i32, words: &str| {
        let run = lab.rmem(&[&["compare"], args].concat()).exits(code);
        assert!(run.stderr.contains(words), "{args:?}: {run}");
    };
    refused(&[], 2, "PATH");
    refused(&["tasks", "--planner", "lama"], 2, "there is no planner `lama`");
    refused(&["tasks", "--planner", "builtin", "--planner", "builtin"], 2, "named twice");
    refused(&["tasks/lights/domain.pddl"], 2, "is a file without problems");
    refused(&["examples"], 3, "there is no task in examples; expected a domain.pddl");
    refused(&["tasks", "--only", "three"], 3, "with `three` in its name");
    refused(&["--stored", "robmem.none"], 3, "robmem.none has no plan");
    lab.write("tasks/lights/wrong.pddl", "(define (problem");
    refused(&["tasks", "--timeout", "0s"], 2, "`0s` leaves no time; expected more than 0");
    refused(&["tasks", "--memory-limit", "1"], 2, "`1` has no unit");
    refused(&["tasks", "--anytime", "--planner", "ff"], 2, "ff cannot improve a plan; leave out --anytime");
    let absent = "[planner.absent]\ncommand = ['/nonexistent/planner']\noutput = 'ff'\n";
    lab.write("rmem.toml", &format!("{}{absent}", lab.read("rmem.toml")));
    refused(
        &["tasks", "--planner", "quitter", "--planner", "absent"],
        127,
        "absent: the planner's program was not found",
    );
    assert_eq!(runs(&lab), 0, "nothing was run");
    refused(&["tasks/lights/domain.pddl", "tasks/lights/wrong.pddl"], 3, "wrong.pddl:1:");
}

#[test]
fn a_task_that_cannot_be_read_counts_as_not_solved() {
    let lab = lab();
    lab.write("tasks/lights/wrong.pddl", "(define (problem");
    let run = lab.rmem(&["compare", "tasks"]).exits(3);
    assert!(run.stderr.contains("lights/wrong cannot be read: tasks/lights/wrong.pddl:1:"), "{run}");
    let rows: Vec<serde_json::Value> = run.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!((&rows[2]["task"], &rows[2]["outcome"]), (&"lights/wrong".into(), &"unreadable".into()), "{run}");
    assert_eq!((&rows[3]["tasks"], &rows[3]["solved"]), (&3.into(), &2.into()), "{run}");
}

#[test]
fn who_says_wrongly_that_there_is_no_plan_has_not_solved_the_task() {
    let lab = lab();
    lab.write("rmem.toml", "[planner.liar]\ncommand = ['/bin/sh', '-c', 'exit 11']\noutput = 'downward'\n");
    let both = ["compare", "tasks", "--only", "one", "--planner", "liar", "--planner", "builtin"];
    for times in ["the first time", "from the memory"] {
        let run = lab.rmem(&both).exits(0);
        let rows: Vec<serde_json::Value> = run.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let message = "it says that no plan exists, but builtin has a valid plan";
        assert_eq!((&rows[0]["outcome"], &rows[0]["message"]), (&"wrong".into(), &message.into()), "{times}: {run}");
        assert_eq!((&rows[2]["solved"], &rows[2]["ipc_satisficing"]), (&0.into(), &0.0.into()), "{times}: {run}");
        assert_eq!((&rows[3]["solved"], &rows[3]["ipc_satisficing"]), (&1.into(), &1.0.into()), "{times}: {run}");
        let is_warned = run.stderr.contains("warning: liar on lights/one: it says that no plan exists");
        assert_eq!(is_warned, times == "the first time", "{run}");
    }
}

#[test]
fn plans_with_times_are_compared_by_their_makespans() {
    let lab = lab();
    let task = crate::lab::root().join("fixtures/tasks/delivery").display().to_string();
    let run = lab.rmem(&["compare", &task]).exits(0);
    let row: serde_json::Value = serde_json::from_str(run.stdout.lines().next().unwrap()).unwrap();
    assert!(row["makespan"].as_f64().unwrap() > 30.0 && row["cost"] == row["makespan"], "{run}");
}

#[test]
fn a_run_is_made_again_where_the_planners_script_has_changed() {
    let lab = lab();
    let script = lab.path().join("planner.sh").display().to_string();
    let log = lab.path().join("log").display().to_string();
    lab.write("rmem.toml", &format!("[planner.script]\ncommand = ['sh', '{script}']\noutput = 'ff'\n"));
    lab.write("planner.sh", &format!("echo run >> {log}; echo 'no licence' >&2; exit 7\n"));
    let words = ["compare", "tasks", "--only", "one", "--planner", "script"];
    let run = lab.rmem(&words).exits(0);
    let row: serde_json::Value = serde_json::from_str(run.stdout.lines().next().unwrap()).unwrap();
    assert_eq!((&row["outcome"], &row["exit_code"]), (&"crashed".into(), &7.into()), "{run}");
    assert_eq!(row["message"], "it exited with 7: no licence", "{run}");
    lab.rmem(&words).exits(0);
    assert_eq!(runs(&lab), 1);
    lab.write("planner.sh", &format!("echo run >> {log}; echo 'search cap reached!'\n"));
    let run = lab.rmem(&words).exits(0);
    assert!(runs(&lab) == 2 && run.stdout.contains("gave-up"), "{run}");
    let kept = lab.rmem(&["query", "robmem.comparisons", "{outcome: 'crashed'}", "--fields", "{run: 1, _id: 0}"]);
    let kept: serde_json::Value = serde_json::from_str(&kept.success()).unwrap();
    assert_eq!((&kept["run"]["command"][0], &kept["run"]["anytime"]), (&"sh".into(), &false.into()), "{kept}");
    assert_eq!(kept["run"]["problem"].as_str().map(str::len), Some(64), "{kept}");
}

#[test]
fn a_task_that_is_named_twice_is_run_once_and_names_do_not_depend_on_the_order() {
    let lab = lab();
    for file in ["domain", "one"] {
        lab.write(&format!("more/lights/{file}.pddl"), &lab.read(&format!("tasks/lights/{file}.pddl")));
    }
    let names = |paths: [&str; 3]| {
        let run = lab.rmem(&[&["compare", "--format", "csv", "--only", "one"], &paths[..]].concat()).exits(0);
        assert!(run.stderr.contains("of the tasks are named twice; each is run once"), "{run}");
        let names = run.stdout.lines().skip(1).filter_map(|line| line.split(',').next());
        let mut names: Vec<String> = names.map(str::to_owned).collect();
        names.sort();
        names
    };
    let wanted = ["more/lights/one", "tasks/lights/one"];
    assert_eq!(names(["tasks", "more", "tasks/lights"]), wanted);
    assert_eq!(names(["more", "tasks/lights", "tasks"]), wanted);
}

#[test]
fn all_problems_of_a_folder_are_compared() {
    let lab = lab();
    let problem = lab.read("tasks/lights/one.pddl");
    let domain = lab.read("tasks/lights/domain.pddl");
    lab.write("several/domain.pddl", &domain);
    ["problem", "problem-2", "p01"].iter().for_each(|name| lab.write(&format!("several/{name}.pddl"), &problem));
    let run = lab.rmem(&["compare", "several", "--planner", "builtin", "--format", "csv"]).success();
    let names: Vec<&str> = run.lines().skip(1).filter_map(|line| line.split(',').next()).collect();
    assert_eq!(names, ["several/p01", "several/problem-2", "several/problem"], "{run}");
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    assert_run!(Lab::empty().rmem(&["compare", "nowhere/"]), @r"
    ------- stderr -------
    error: there is no file or folder nowhere/
    [exit code: 3]
    ");
}

#[test]
fn a_folder_of_problems_is_for_the_domain_before_it() {
    let lab = lab();
    std::fs::rename(lab.path().join("tasks/lights/domain.pddl"), lab.path().join("d.pddl")).unwrap();
    lab.write("empty/README", "");
    let compare = |places: &[&'static str]| {
        lab.rmem(&[&["compare"], places, &["--planner", "builtin", "--format", "csv"]].concat())
    };
    let names = |run: crate::lab::Finished| -> Vec<String> {
        run.success().lines().skip(1).filter_map(|line| line.split(',').next().map(str::to_owned)).collect()
    };
    assert_eq!(names(compare(&["d.pddl", "tasks/lights"])), ["one", "two"]);
    for places in [&["tasks/lights"][..], &["d.pddl", "empty", "tasks/lights/one.pddl"]] {
        let run = compare(places).exits(3);
        assert!(run.stderr.contains("there is no task in "), "{run}");
    }
}

#[test]
fn runs_are_repeated_where_that_is_asked_for() {
    let lab = lab();
    let compare = ["compare", "tasks", "--planner", "quitter", "--format", "csv"];
    let text = lab.rmem(&[&compare[..], &["--repeat", "3"]].concat()).success();
    assert_eq!((text.lines().count(), runs(&lab)), (3, 6));
    // Other numbers are other runs, and the same ones are kept.
    lab.rmem(&compare).success();
    assert_eq!(runs(&lab), 8);
    lab.rmem(&[&compare[..], &["--repeat", "3"]].concat()).success();
    assert_eq!(runs(&lab), 8);
    lab.rmem(&[&compare[..], &["--repeat", "0"]].concat()).exits(2);
}

#[test]
fn a_message_says_how_many_runs_failed() {
    let lab = lab();
    let flaky = format!(
        "[planner.flaky]\noutput = 'ff'\ncommand = ['/bin/sh', '-c', 'if [ -e {path}/done ]; then exec {rmem} ff -o {{domain}} -f {{problem}}; \
         else : > {path}/done; echo junk; fi']\n",
        path = lab.path().display(),
        rmem = crate::lab::rmem().display()
    );
    lab.write("rmem.toml", &flaky);
    let words = ["compare", "tasks/lights/domain.pddl", "tasks/lights/one.pddl", "--planner", "flaky", "--repeat", "3"];
    let text = lab.rmem(&[&words[..], &["--format", "json"]].concat()).success();
    assert!(text.contains("\"success\"") && text.contains("1 of 3 runs failed (invalid)"), "{text}");
}

#[test]
fn a_plan_that_cannot_be_checked_solves_nothing() {
    let lab = lab();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :constraints) (:predicates (p)) (:action a :parameters () :effect (p)))",
    );
    let task = |constraint: &str| {
        lab.write("p.pddl", &format!("(define (problem t) (:domain d) (:goal (p)) (:constraints {constraint}))"));
        lab.write("rmem.toml", "[planner.one]\noutput = 'ff'\ncommand = ['/bin/sh', '-c', 'echo ff: found legal plan as follows; echo step 0: A']\n");
        let words = ["compare", "d.pddl", "p.pddl", "--planner", "one", "--format", "csv"];
        lab.rmem(&words).success() + &lab.rmem(&[&words[..], &["--scores"]].concat()).success()
    };
    let text = task("(always (sometime (p)))");
    assert!(text.contains(",unchecked,") && text.contains("one,1,0,0.0,"), "{text}");
    assert!(task("(sometime (p))").contains("one,1,1,1.0,"));
    assert!(task("(always (p))").contains(",invalid,"));
}
