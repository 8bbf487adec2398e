//! The limits of planners: time, memory, output, interruption; and what is left of them.

use crate::lab::watch::until;
use crate::lab::{Lab, TASK, assert_run, plan};

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
    assert_run!(plan(&lab, &["--planner", "sleeper", "--timeout", "300ms"]), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: sleeper: the planner ran out of time: no plan within 300ms
    [exit code: 23]
    ");
    assert_run!(plan(&lab, &["--planner", "crasher"]), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: crasher: its program was ended by signal 11
      the last lines it printed:
        broken
    [exit code: 32]
    ");
    assert_run!(plan(&lab, &["--planner", "liar"]), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: liar: the plan is invalid: step 1: (pickup A) is not applicable: (clear A) is false
    [exit code: 32]
    ");
    assert_run!(plan(&lab, &["--planner", "spammer"]), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: spammer: its program printed more than 16 MiB
      the last lines it printed:
        step
        step
        step
        step
        step
        step
        step
        step
        step
        step
        step
        s
    [exit code: 32]
    ");
}

#[test]
fn a_limit_of_memory_is_22() {
    let (domain, problem) = ("fixtures/tasks/explosion/domain.pddl", "fixtures/tasks/explosion/problem.pddl");
    let args = ["plan", "-d", domain, "-p", problem, "--memory-limit", "100M", "--timeout", "60s", "--no-store"];
    assert_run!(Lab::new().rmem(&args), @r"
    ------- stderr -------
    error: builtin: the planner ran out of memory: memory allocation of 67108864 bytes for the stack failed: Resource temporarily unavailable; its limit was 100 MiB
    [exit code: 22]
    ");
}

#[test]
fn an_action_with_too_many_instances_for_the_memory_is_named() {
    let objects: Vec<String> = (0..120).map(|number| format!("o{number}")).collect();
    let facts: Vec<String> = objects.iter().map(|name| format!("(p {name})")).collect();
    let problem = format!(
        "(define (problem all) (:domain many) (:objects {}) (:init {} (= (n) 0)) (:goal (and (q o1 o2 o3 o4) (>= (n) 1))))",
        objects.join(" "),
        facts.concat()
    );
    let head = "(define (domain many) (:requirements :numeric-fluents :durative-actions)
        (:predicates (p ?x) (q ?x ?y ?z ?w)) (:functions (n))";
    let timeless =
        "(:action connect :parameters (?x ?y ?z ?w) :precondition (and (p ?x) (p ?y) (p ?z) (p ?w) (< (n) 2))
        :effect (and (q ?x ?y ?z ?w) (increase (n) 1))))";
    let timed = "(:durative-action connect :parameters (?x ?y ?z ?w) :duration (= ?duration 1)
        :condition (and (at start (p ?x)) (at start (p ?y)) (at start (p ?z)) (over all (p ?w)))
        :effect (at end (q ?x ?y ?z ?w))))";
    for (action, problem) in [(timeless, problem.clone()), (timed, problem.replace("(>= (n) 1)", ""))] {
        let lab = Lab::new();
        lab.write("d.pddl", &format!("{head} {action}"));
        lab.write("p.pddl", &problem);
        let limits = ["--memory-limit", "300M", "--timeout", "120s", "--no-store"];
        let run = lab.rmem(&[&["plan", "-d", "d.pddl", "-p", "p.pddl"], &limits[..]].concat());
        assert_eq!(run.code, 22, "{}", run.stderr);
        assert!(run.stderr.contains("the action connect has "), "{}", run.stderr);
        assert!(run.stderr.contains("its limit was 300 MiB"), "{}", run.stderr);
    }
}

#[test]
fn what_explodes_is_named_in_the_domains_spelling_where_it_is_no_action() {
    let lab = Lab::new();
    let objects: Vec<String> = (0..40).map(|number| format!("o{number}")).collect();
    let derived = "(:derived (Near ?a ?b ?c ?d ?e ?f) (and (not (e ?a ?b)) (not (e ?c ?d)) (not (e ?e ?f))))
        (:action huge :parameters (?a) :precondition (exists (?b ?c ?d ?e ?f) (Near ?a ?b ?c ?d ?e ?f)) :effect (done))";
    let effect = "(:action Huge :parameters (?a) :precondition (and)
        :effect (and (done) (forall (?b ?c ?d ?e ?f) (when (not (e ?b ?c)) (Near ?a ?b ?c ?d ?e ?f)))))";
    let problem = format!("(define (problem p) (:domain d) (:objects {}) (:init) (:goal (done)))", objects.join(" "));
    lab.write("p.pddl", &problem);
    for (actions, named) in
        [(derived, "the derived predicate Near has "), (effect, "`forall` in an effect of the action Huge has ")]
    {
        let predicates = "(:predicates (Near ?a ?b ?c ?d ?e ?f) (done) (e ?a ?b))";
        lab.write(
            "d.pddl",
            &format!("(define (domain d) (:requirements :adl :derived-predicates) {predicates} {actions})"),
        );
        let limits = ["--memory-limit", "300M", "--timeout", "120s", "--no-store"];
        let run = lab.rmem(&[&["plan", "-d", "d.pddl", "-p", "p.pddl"], &limits[..]].concat()).exits(22);
        assert!(run.stderr.contains(named) && run.stderr.contains(" instances"), "{run}");
    }
}

#[test]
fn a_limit_of_memory_is_the_same_one_each_time() {
    let lab = Lab::new();
    let folder = "fixtures/tasks/durative-numeric";
    let (domain, problem) = (format!("{folder}/domain.pddl"), format!("{folder}/problem.pddl"));
    for limit in ["120M", "200M"] {
        let args = ["plan", "-d", &domain, "-p", &problem, "--memory-limit", limit, "--timeout", "60s", "--no-store"];
        let codes: Vec<i32> = (0..3).map(|_| lab.rmem(&args).code).collect();
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
    until("the planner runs", || {
        assert!(child.try_wait().unwrap().is_none(), "it ended before its planner started");
        sleepers(&lab) > 0
    });
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
    let is_left = || sleepers(&lab) > 0 || std::fs::read_dir(lab.path().join("tmp")).unwrap().count() > 0;
    until("nothing is left of the planner", || !is_left());
}

#[test]
fn a_planner_that_begins_before_a_large_task_is_checked_ends_where_that_is_wrong_or_refused() {
    let lab = Lab::new();
    let tmp = lab.path().join("tmp");
    std::fs::create_dir(&tmp).unwrap();
    let lab = lab.env("TMPDIR", &tmp.display().to_string());
    let domain =
        "(define (domain d) (:predicates (p ?x) (q)) (:action a :parameters (?x) :precondition (p ?x) :effect (q)))";
    let objects: Vec<String> = (0..8_000).map(|number| format!("object-{number}")).collect();
    let problem = |first: &str, goal: &str| {
        let objects = objects.join(" ");
        format!("(define (problem n) (:domain d) (:objects {first} {objects}) (:init (P {first})) (:goal {goal}))")
    };
    let refused = domain.replace(":effect (q)", ":vars (?y) :effect (q)");
    for (domain, problem, code) in [
        (domain, problem("it", "(q)"), 0),
        // A name that is sent as another.
        (domain, problem("1.it", "(q)"), 0),
        (domain, problem("it", "(and (q) (r))"), 3),
        (domain, problem("it", "(q"), 3),
        (&refused, problem("it", "(q)"), 34),
    ] {
        lab.write("d.pddl", domain);
        lab.write("p.pddl", &problem);
        let run = lab.rmem(&["-q", "plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]).exits(code);
        assert!(code != 0 || run.stdout.starts_with("(a it)\n") || run.stdout.starts_with("(a 1.it)\n"), "{run}");
        assert_eq!(std::fs::read_dir(&tmp).unwrap().count(), 0, "{run}");
    }
}

#[test]
fn an_interruption_while_a_large_task_is_checked_leaves_no_files() {
    let lab = Lab::new();
    let tmp = lab.path().join("tmp");
    std::fs::create_dir(&tmp).unwrap();
    // The planner would not end soon: the action has a million million instances.
    lab.write(
        "d.pddl",
        "(define (domain d) (:predicates (p ?x) (q ?x ?y ?z ?t))
           (:action a :parameters (?x ?y ?z ?t) :precondition (and (p ?x) (p ?y) (p ?z) (p ?t)) :effect (q ?x ?y ?z ?t)))",
    );
    let objects: Vec<String> = (0..1000).map(|number| format!("object-{number}")).collect();
    let facts: Vec<String> = (0..100_000).map(|number| format!("(p object-{})", number % 1000)).collect();
    let (objects, facts) = (objects.join(" "), facts.join(" "));
    let goal = "(q object-0 object-1 object-2 object-3)";
    lab.write(
        "p.pddl",
        &format!("(define (problem n) (:domain d) (:objects {objects}) (:init {facts}) (:goal {goal}))"),
    );
    let mut command = std::process::Command::new(crate::lab::rmem());
    command.args(["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]);
    lab.isolate(&mut command);
    let mut child = command.env("TMPDIR", &tmp).stderr(std::process::Stdio::null()).spawn().unwrap();
    // The planner has the problem, and reads it as rmem does.
    let has_problem = |folder: std::fs::DirEntry| folder.path().join("problem.pddl").exists();
    until("the planner begins", || std::fs::read_dir(&tmp).unwrap().flatten().any(has_problem));
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(std::fs::read_dir(&tmp).unwrap().count(), 0);
}

#[test]
fn a_wrong_task_leaves_no_files_of_the_planner_prepared_for_it() {
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

#[test]
fn a_run_without_room_for_its_files_is_4_and_no_failed_plan() {
    let lab = Lab::new().env("RMEM_MEMORY", "file:robot.rmem").env("TMPDIR", "/nonexistent");
    let refused = crate::lab::plan(&lab, &["--planner", "ff"]).exits(4);
    assert_run!(refused, @r"
    ------- stderr -------
    error: /nonexistent: its program could not be run: no files can be made for a run in /nonexistent: entity not found; create the folder, or set TMPDIR
    [exit code: 4]
    ");
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "0\n");
}

#[test]
fn a_tmpdir_that_is_empty_is_none() {
    let lab = Lab::new().env("TMPDIR", "");
    lab.write("rmem.toml", "[planner.spy]\ncommand = [\"./spy\", \"{domain}\", \"{problem}\"]\noutput = \"ff\"\n");
    lab.write("spy", "#!/bin/sh\npwd > \"$(dirname \"$0\")/seen\"\n");
    lab.shell("chmod +x spy").success();
    let _ = crate::lab::plan(&lab, &["--planner", "spy"]);
    let seen = lab.read("seen");
    assert!(seen.starts_with("/tmp/") && !seen.starts_with(&lab.path().display().to_string()), "{seen}");
}
