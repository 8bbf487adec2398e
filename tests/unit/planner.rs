//! Planners under limits. The programs here are fakes that do what real planners
//! cannot be made to do on demand; the built-in planner is real.

use std::fs;
use std::io::{Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rmem::exit::Exit;
use rmem::formats::Source;
use rmem::formats::pddl::Dialect as Spelling;
use rmem::pddl::{Domain, Problem};
use rmem::planner::{Builtin, Configured, Dialect, Ff, Host, Limits, Outcome, Planner, Portfolio, Run, Task, run};
use tempfile::TempDir;

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing) (:types t)
  (:predicates (p ?x - t) (q ?x - t))
  (:action Go :parameters (?x - t) :precondition (p ?x) :effect (q ?x)))";
const PROBLEM: &str = "(define (problem n) (:domain d) (:objects A b.c - t) (:init (p A) (p b.c)) (:goal (q A)))";

/// A planner's run in a place of its own, where nothing may be left afterwards.
struct Place {
    directory: TempDir,
    domain: Domain,
    problem: Problem,
    interrupted: AtomicBool,
}

impl Place {
    fn new() -> Self {
        Self::with(DOMAIN, PROBLEM)
    }

    fn with(domain: &str, problem: &str) -> Self {
        let domain = Domain::read(&Source::new("d.pddl", domain), Spelling::default()).unwrap();
        let problem = Problem::read(&Source::new("p.pddl", problem), &domain, Spelling::default()).unwrap();
        Self { directory: tempfile::tempdir().unwrap(), domain, problem, interrupted: AtomicBool::new(false) }
    }

    fn fixture(domain: &str, problem: &str) -> Self {
        let read = |name: &str| {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/transcripts/tasks");
            fs::read_to_string(folder.join(format!("{name}.pddl"))).unwrap()
        };
        Self::with(&read(domain), &read(problem))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn script(&self, name: &str, body: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, format!("#!/bin/sh\n{body}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    fn host(&self) -> Host<'_> {
        let temporary = self.path("tmp");
        fs::create_dir_all(&temporary).unwrap();
        Host {
            exe: env!("CARGO_BIN_EXE_rmem").into(),
            temporary,
            interrupted: &self.interrupted,
            listener: Default::default(),
        }
    }

    fn task(&self) -> Task<'_> {
        Task { domain: &self.domain, problem: &self.problem }
    }

    fn run(&self, planner: &dyn Planner, limits: &Limits) -> Run {
        let run = run(planner, &self.task(), limits, &self.host());
        assert_eq!(fs::read_dir(self.path("tmp")).unwrap().count(), 0, "the run left files");
        run
    }

    /// Runs a fake `ff`.
    fn ff(&self, body: &str, limits: &Limits) -> Run {
        let program = self.script("ff", body);
        self.run(&Ff { program: program.into() }, limits)
    }

    fn configured(&self, body: &str, output: Dialect, limits: &Limits) -> Run {
        self.script("fake", body);
        let command = ["./fake", "{domain}", "{problem}", "{plan}"].map(str::to_owned).to_vec();
        let folder = self.directory.path().to_owned();
        self.run(&Configured { name: "fake".to_owned(), command, output, lacks: Vec::new(), folder }, limits)
    }
}

fn within(seconds: f64) -> Limits {
    Limits { time: Some(Duration::from_secs_f64(seconds)), ..Limits::default() }
}

fn steps(run: &Run) -> Vec<String> {
    let plan = run.outcome.plan().unwrap_or_else(|| panic!("{run:?}"));
    plan.steps.iter().map(|step| format!("{} {}", step.action, step.arguments.join(" "))).collect()
}

/// Whether a process is alive; a zombie is not.
fn lives(pid: &str) -> bool {
    let stat = fs::read_to_string(format!("/proc/{}/stat", pid.trim())).unwrap_or_default();
    stat.rsplit_once(") ").is_some_and(|(_, rest)| !rest.starts_with('Z'))
}

/// How long what has to come may take.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Waits until something is so.
#[track_caller]
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let since = Instant::now();
    while !is_so() {
        assert!(since.elapsed() < TIMEOUT, "waited in vain until {what}");
        thread::sleep(Duration::from_millis(5));
    }
}

#[track_caller]
fn dies(pid: &str) {
    until(&format!("process {pid} is gone"), || !lives(pid));
}

/// Whether a program has written into a file.
fn is_written(path: &Path) -> bool {
    fs::read_to_string(path).is_ok_and(|text| text.ends_with('\n'))
}

const FOUND: &str = "echo; echo 'ff: found legal plan as follows'; echo; echo 'step    0: GO A'; echo 'time spent: 0'";

#[test]
fn a_plan_comes_back_in_the_problems_spelling() {
    let run = Place::new().ff(FOUND, &within(10.0));
    assert_eq!(steps(&run), ["Go A"]);
    assert_eq!(run.command, ["ff", "-o", "{domain}", "-f", "{problem}"]);
}

#[test]
fn ff_gets_names_it_understands() {
    let place = Place::new();
    let seen = place.path("seen");
    let body = format!("cd /; cat \"$4\" > {}; {}", seen.display(), FOUND.replace("GO A", "GO B_C"));
    assert_eq!(steps(&place.ff(&body, &within(10.0))), ["Go b.c"]);
    let sent = fs::read_to_string(seen).unwrap();
    assert!(sent.contains("b_c") && !sent.contains("b.c"), "{sent}");
}

#[test]
fn metric_ff_is_asked_again_with_its_option() {
    let body = format!(
        "test \"$5\" = -s && {{ {FOUND}; exit 0; }}; echo 'Error! Optimization criterion not established.'; exit 1"
    );
    let run = Place::new().ff(&body, &within(10.0));
    assert_eq!(steps(&run), ["Go A"]);
    assert_eq!(run.command[5..], ["-s", "0"]);
}

#[test]
fn the_memory_of_two_runs_is_the_larger_of_both() {
    let body = format!(
        "test \"$5\" = -s && {{ {FOUND}; exit 0; }}; x=$(head -c 60000000 /dev/zero | tr '\\0' a); \
         echo 'Error! Optimization criterion not established.'; exit 1"
    );
    let run = Place::new().ff(&body, &within(60.0));
    assert!(steps(&run) == ["Go A"] && run.memory > Some(50 << 20), "{run:?}");
}

#[test]
fn a_run_whose_directory_cannot_be_removed_has_its_result() {
    let run = Place::new().ff("directory=$PWD; cd /; rm -r \"$directory\"; exit 7", &within(10.0));
    assert_eq!(run.code, Some(7), "{run:?}");
}

#[test]
fn outcomes_of_ff_come_from_its_text() {
    for (body, code) in [
        ("echo 'best first search space empty! problem proven unsolvable.'", 11),
        ("echo 'ff: goal can be simplified to FALSE. No plan will solve it' >&2; exit 1", 11),
        ("echo 'ff: goal can be simplified to TRUE. The empty plan solves it'; exit 1", 0),
        ("echo 'Astar epsilon search space empty!'; echo 'Bailing out.'", 12),
        ("echo 'too many constants! increase MAX_CONSTANTS (currently 2000)'; exit 1", 34),
        ("echo 'domain.pddl: syntax error in line 2, x:'; exit 1", 32),
        ("echo 'ff: unknown option: O entered'; exit 1", 32),
        ("echo hello", 32),
        ("exit 139", 32),
        ("kill -SEGV $$", 32),
        ("exec /no/such/program", 127),
    ] {
        let run = Place::new().ff(body, &within(10.0));
        assert_eq!(Exit::from(&run.outcome).code(), code, "{body}: {run:?}");
    }
}

#[test]
fn a_crash_in_the_middle_of_a_plan_is_not_a_plan() {
    let run =
        Place::new().ff("echo 'ff: found legal plan as follows'; echo 'step 0: GO A'; kill -SEGV $$", &within(10.0));
    assert_eq!(run.outcome, Outcome::Failed);
    assert!(run.message.contains("signal 11"), "{}", run.message);
    assert!(run.tail().contains("step 0: GO A"));
}

#[test]
fn ffs_proof_is_not_believed_with_conditional_effects() {
    let place = Place::fixture("ffbug_dom", "ffbug_p1");
    let run = place.ff("echo 'best first search space empty! problem proven unsolvable.'", &within(10.0));
    assert_eq!(run.outcome, Outcome::GaveUp);
}

#[test]
fn a_program_that_is_not_there_is_named() {
    let place = Place::new();
    let run = place.run(&Ff { program: "no-such-ff".into() }, &within(10.0));
    assert_eq!(run.outcome, Outcome::NotFound);
    assert!(run.message.contains("`no-such-ff`") && run.message.contains("cargo install"), "{}", run.message);
}

#[test]
fn what_a_planner_cannot_do_is_refused_with_the_line() {
    let place = Place::fixture("durdom", "durp");
    let run = place.ff("touch ran", &within(10.0));
    assert_eq!(run.outcome, Outcome::Unsupported);
    assert!(run.message.starts_with("d.pddl:5:"), "{}", run.message);
    assert!(run.message.contains("durative actions"), "{}", run.message);
    assert_eq!(run.command, Vec::<String>::new());
}

#[test]
fn a_task_that_is_larger_than_ffs_tables_is_refused_with_the_line() {
    let wide = "(define (domain d) (:predicates (p)
      (r ?a ?b ?c ?d ?e ?f)) (:action a :effect (p)))";
    let many: String = (0..50).map(|number| format!("(q{number}) ")).collect();
    let many = format!("(define (domain d) (:predicates {many}\n(p)) (:action a :effect (p)))");
    let plain = "(define (domain d) (:predicates (p)) (:action a :effect (p)))";
    let objects: String = (0..2000).map(|number| format!("o{number} ")).collect();
    let small = "(define (problem n) (:domain d) (:goal (p)))";
    let large = format!("(define (problem n) (:domain d) (:objects {objects}\nlast) (:goal (p)))");
    for (domain, problem, place, what) in [
        (wide, small, "d.pddl:2:8:", "5 arguments; `r` has 6"),
        (&many, small, "d.pddl:2:2:", "50 predicates; there are 51"),
        (plain, &large, "p.pddl:2:1:", "2000 constants and objects; there are 2001"),
    ] {
        let place_of_run = Place::with(domain, problem);
        let ran = place_of_run.path("ran");
        let run = place_of_run.ff(&format!("touch {}", ran.display()), &within(10.0));
        assert_eq!(run.outcome, Outcome::Unsupported);
        assert!(run.message.starts_with(place) && run.message.contains(what), "{}", run.message);
        assert!(!ran.exists(), "it ran");
        // The present-day program has no such tables.
        place_of_run.ff(&format!("touch {}; : ferroplan", ran.display()), &within(10.0));
        assert!(ran.exists(), "it did not run");
    }
}

#[test]
fn a_program_that_ignores_term_is_killed() {
    let place = Place::new();
    let pid = place.path("pid");
    let started = Instant::now();
    let run =
        place.ff(&format!("trap '' TERM; echo $$ > {}; while :; do sleep 0.05; done", pid.display()), &within(3.0));
    assert_eq!(run.outcome, Outcome::OutOfTime);
    assert!(started.elapsed() < TIMEOUT, "{:?}", started.elapsed());
    dies(&fs::read_to_string(pid).unwrap());
}

#[test]
fn a_program_that_ends_on_term_is_not_waited_for() {
    let started = Instant::now();
    let run = Place::new().ff("exec sleep 600", &within(0.2));
    assert_eq!(run.outcome, Outcome::OutOfTime);
    assert!(started.elapsed() < TIMEOUT, "{:?}", started.elapsed());
}

#[test]
fn daemons_are_not_left_behind() {
    let place = Place::new();
    let pid = place.path("pid");
    let file = pid.display();
    let daemon = format!("setsid sh -c 'echo $$ > {file}; exec sleep 600' & until [ -s {file} ]; do sleep 0.01; done");
    let run = place.ff(&format!("{daemon}; {FOUND}"), &within(10.0));
    assert_eq!(steps(&run), ["Go A"]);
    let one = fs::read_to_string(&pid).unwrap();
    assert!(!one.trim().is_empty() && !lives(&one), "the daemon {one} is still there");

    fs::remove_file(&pid).unwrap();
    let run = place.ff(&format!("({daemon}) & {daemon}; sleep 600"), &within(3.0));
    assert_eq!(run.outcome, Outcome::OutOfTime);
    assert!(!lives(&fs::read_to_string(&pid).unwrap()), "the daemon outlived the limit");
}

#[test]
fn an_interruption_stops_the_run() {
    let place = Place::new();
    let pid = place.path("pid");
    let started = Instant::now();
    let run = thread::scope(|scope| {
        scope.spawn(|| {
            until("the program runs", || is_written(&pid));
            place.interrupted.store(true, Ordering::Relaxed);
        });
        place.ff(&format!("echo $$ > {}; exec sleep 600", pid.display()), &within(200.0))
    });
    assert_eq!(run.outcome, Outcome::Interrupted);
    assert!(started.elapsed() < 2 * TIMEOUT);
    assert!(!lives(&fs::read_to_string(pid).unwrap()));
}

#[test]
fn a_flood_of_output_is_stopped() {
    let limits = Limits { output: 1 << 20, ..within(30.0) };
    let run = Place::new().ff("exec yes", &limits);
    assert_eq!(run.outcome, Outcome::NoPlan);
    assert!(run.message.contains("more than 1 MiB"), "{}", run.message);
    assert!(run.stdout.len() <= 1 << 20);
}

#[test]
fn a_limit_of_memory_is_kept() {
    let limits = Limits { memory: Some(256 << 20), ..within(30.0) };
    let run = Place::new().ff("exec tail /dev/zero", &limits);
    assert_eq!(run.outcome, Outcome::OutOfMemory, "{run:?}");
    let run = Place::new().ff("ulimit -v; ulimit -c", &limits);
    assert_eq!(run.stdout, "262144\n0\n");
}

#[test]
fn the_last_of_a_temporal_planners_plans_is_taken_at_the_limit() {
    let body = "echo '; Plan found with metric 2'; echo '0.000: (go a) [1.000]'; echo '2.000: (go a) [1.000]'; \
                echo '; Plan found with metric 1'; echo '0.000: (go b_c) [1.000]'; sleep 600";
    let run = Place::new().configured(body, Dialect::Temporal, &within(3.0));
    assert_eq!(steps(&run), ["Go b.c"]);
    // Its task knows no time.
    assert_eq!(run.outcome.plan().unwrap().steps[0].duration, None);
}

#[test]
fn actions_that_touch_are_set_apart() {
    let domain =
        "(define (domain d) (:requirements :durative-actions :timed-initial-literals) (:predicates (p) (q) (r) (open))
      (:durative-action heat :parameters () :duration (= ?duration 5) :condition () :effect (at end (p)))
      (:durative-action rest :parameters () :duration (= ?duration 0) :condition (at start (p)) :effect (at end (q)))
      (:durative-action pour :parameters () :duration (= ?duration 2)
        :condition (and (at start (q)) (over all (open))) :effect (at end (r))))";
    let problem = "(define (problem n) (:domain d) (:init (at 5 (open))) (:goal (r)))";
    let place = Place::with(domain, problem);
    let run = |plan: &str| {
        let mut run = place.configured(&format!("printf '{plan}'"), Dialect::Temporal, &within(10.0));
        run.simulate(&place.task());
        let starts = run.outcome.plan().map(|plan| plan.steps.iter().filter_map(|step| step.start).collect::<Vec<_>>());
        (starts, run.is_spaced, Exit::from(&run.outcome).code())
    };
    let touching = run(r"0.000: (heat) [5.000]\n5.000: (rest) [0.000]\n5.000: (pour) [2.000]\n");
    assert_eq!(touching, (Some(vec![0.0, 5.001, 5.002]), true, 0));
    let apart = run(r"0.000: (heat) [5.000]\n5.500: (rest) [0.000]\n5.600: (pour) [2.000]\n");
    assert_eq!(apart, (Some(vec![0.0, 5.5, 5.6]), false, 0), "a valid plan stays as it is");
    let wrong = run(r"0.000: (heat) [5.000]\n5.000: (pour) [2.000]\n");
    assert_eq!(wrong, (None, false, 32), "what lacks an action stays invalid");
}

#[test]
fn half_a_plan_file_is_not_a_plan() {
    let run =
        Place::new().configured("echo '(go a)' > \"$3\"; echo '(go b' >> \"$3\"", Dialect::Downward, &within(10.0));
    assert_eq!(run.outcome, Outcome::NoPlan);
    assert!(run.message.contains("plan:2:"), "{}", run.message);
    let body = "echo '(go a)' > \"$3\"; echo '; cost = 1 (unit cost)' >> \"$3\"";
    let run = Place::new().configured(body, Dialect::Downward, &within(10.0));
    assert_eq!((steps(&run), run.outcome.plan().unwrap().cost), (vec!["Go A".to_owned()], Some(1.0)));
}

#[test]
fn exit_codes_of_fast_downward_are_outcomes() {
    for (code, outcome) in [(11, 11), (12, 12), (22, 22), (23, 23), (31, 32), (34, 34), (30, 32), (0, 32), (139, 32)] {
        let run = Place::new().configured(&format!("exit {code}"), Dialect::Downward, &within(10.0));
        assert_eq!(Exit::from(&run.outcome).code(), outcome, "exit {code}: {run:?}");
    }
}

/// A supervisor as rmem starts it, and its lifeline, which ends as it does when rmem is killed.
fn supervisor(directory: &Path, program: &Path) -> (UnixStream, Child) {
    let (ours, theirs) = UnixStream::pair().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
    command.args(["__supervisor", "--directory"]).arg(directory).arg("--").arg(program);
    (ours, command.stdin(Stdio::from(OwnedFd::from(theirs))).spawn().unwrap())
}

#[test]
fn a_program_whose_task_never_comes_does_not_run() {
    let place = Place::new();
    let ran = place.path("ran");
    let program = place.script("ff", &format!("touch {}", ran.display()));
    let directory = place.path("run");
    for goodbye in ["", "done\n", "stop\n"] {
        fs::create_dir(&directory).unwrap();
        let (mut lifeline, mut supervisor) = supervisor(&directory, &program);
        let mut printed = [0; 64];
        let length = lifeline.read(&mut printed).unwrap();
        let printed = String::from_utf8_lossy(&printed[..length]).into_owned();
        let pid = printed.strip_prefix("started ").unwrap_or_else(|| panic!("{printed}")).trim();
        assert!(lives(pid), "the program is there, and waits");
        lifeline.write_all(goodbye.as_bytes()).unwrap();
        if goodbye.is_empty() {
            drop(lifeline);
        }
        supervisor.wait().unwrap();
        assert!(!lives(pid) && !ran.exists() && !directory.exists(), "after {goodbye:?}");
    }

    let planners: [Box<dyn Planner>; 2] = [Box::new(Ff { program: program.into() }), Box::new(Builtin::default())];
    drop(Portfolio::new(&planners, &within(10.0), &place.host()));
    assert_eq!(fs::read_dir(place.path("tmp")).unwrap().count(), 0);
    assert!(!ran.exists());
}

#[test]
fn nothing_is_left_when_rmem_itself_is_killed() {
    let place = Place::new();
    let (pid, program) = (place.path("pid"), place.path("child"));
    place.script(
        "child",
        &format!("trap '' TERM; setsid sleep 600 & echo $! $$ > {}; while :; do sleep 0.1; done", pid.display()),
    );
    let directory = place.path("run");
    fs::create_dir(&directory).unwrap();
    let (mut lifeline, mut supervisor) = supervisor(&directory, &program);
    lifeline.write_all(b"go\n").unwrap();
    until("the program runs", || is_written(&pid));
    drop(lifeline);
    supervisor.wait().unwrap();
    let pids = fs::read_to_string(&pid).unwrap();
    for pid in pids.split_whitespace() {
        assert!(!lives(pid), "process {pid} is still there");
    }
    assert!(!directory.exists(), "the directory is still there");
}

#[test]
fn the_builtin_planner_answers_like_any_other() {
    for (domain, problem, code) in [
        ("dom", "p_plan", 0),
        ("dom", "p_goaltrue", 0),
        ("dom", "p_unsolv_search", 11),
        ("dom", "p_goalfalse_unreach", 11),
        ("ndom", "np", 0),
        ("ndom", "np_unreach", 11),
        ("durdom", "durp", 0),
        ("adldom", "adlp", 0),
        ("ffbug_dom", "ffbug_p1", 0),
        ("names_dom", "names_p3", 0),
    ] {
        let run = Place::fixture(domain, problem).run(&Builtin::default(), &within(30.0));
        assert_eq!(Exit::from(&run.outcome).code(), code, "{domain} {problem}: {run:?}");
    }
}

#[test]
fn the_builtin_planner_is_limited_like_any_other() {
    let objects: Vec<String> = (0..60).map(|number| format!("o{number}")).collect();
    let domain = "(define (domain d) (:requirements :strips) (:predicates (r ?a ?b ?c ?d ?e) (g))
      (:action a :parameters (?a ?b ?c ?d ?e) :precondition (and) :effect (r ?a ?b ?c ?d ?e))
      (:action b :parameters (?a ?b ?c ?d ?e) :precondition (and (r ?a ?b ?c ?d ?e) (r ?e ?d ?c ?b ?a)) :effect (g)))";
    let problem = format!("(define (problem n) (:domain d) (:objects {}) (:init) (:goal (g)))", objects.join(" "));
    let place = Place::with(domain, &problem);
    assert_eq!(place.run(&Builtin::default(), &within(0.5)).outcome, Outcome::OutOfTime);
    let limits = Limits { memory: Some(400 << 20), ..within(60.0) };
    assert_eq!(place.run(&Builtin::default(), &limits).outcome, Outcome::OutOfMemory);
}

/// `rmem ff` in a folder, as a program written for FF calls it.
fn speak_ff(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_rmem")).arg("ff").args(arguments).current_dir(folder).output();
    let output = output.unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

fn tasks() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/transcripts/tasks")
}

#[test]
fn an_ill_formed_task_is_an_error_to_the_builtin_planner_and_no_proof() {
    for (domain, problem, place) in [
        ("dom", "p_undeclared_obj", "p_undeclared_obj.pddl:4:"),
        ("dom", "p_undeclared_pred", "p_undeclared_pred.pddl:"),
        ("dom", "p_arity", "p_arity.pddl:"),
        ("dom", "p_typemismatch", "p_typemismatch.pddl:"),
        ("dom", "p_init_typemismatch", "p_init_typemismatch.pddl:"),
        ("dom", "p_wrongdomain", "p_wrongdomain.pddl:1:"),
        ("dom", "p_syntax", "p_syntax.pddl:"),
        ("dom_undeclpred", "p_plan", "dom_undeclpred.pddl:"),
    ] {
        let (code, stdout, stderr) =
            speak_ff(&tasks(), &["-o", &format!("{domain}.pddl"), "-f", &format!("{problem}.pddl")]);
        assert_eq!(code, Some(3), "{problem}: {stdout}{stderr}");
        assert!(stderr.contains(place), "{problem}: {stderr}");
        assert!(!stdout.contains("legal plan") && !stdout.contains("FALSE"), "{problem}: {stdout}");
    }
}

#[test]
fn the_builtin_planner_keeps_names_that_its_engine_cannot_read() {
    let place = Place::new();
    fs::write(place.path("d.pddl"), DOMAIN).unwrap();
    let problem = "(define (problem n) (:domain d) (:objects 1a 2a - t) (:init (p 1a) (p 2a)) (:goal (and (q 2a))))";
    fs::write(place.path("p.pddl"), problem).unwrap();
    let (code, stdout, stderr) = speak_ff(place.directory.path(), &["-o", "d.pddl", "-f", "p.pddl"]);
    assert_eq!(code, Some(0), "{stdout}{stderr}");
    assert!(stdout.contains("step    0: GO 2A"), "{stdout}");
}

#[test]
fn the_builtin_planner_takes_the_options_of_ff() {
    let folder = tasks();
    let prefix = format!("{}/", folder.display());
    let words = ["-p", &prefix, "-o", "dom.pddl", "-f", "p_goaltrue.pddl", "-i", "0", "-s", "3", "-E", "-O", "-C"];
    let weights = ["-g", "1", "-h", "5", "-w", "2", "-r", "7"];
    let (code, stdout, stderr) = speak_ff(&std::env::temp_dir(), &[&words[..], &weights[..]].concat());
    assert_eq!(code, Some(0), "{stdout}{stderr}");
    assert!(stdout.contains("ff: goal can be simplified to TRUE. The empty plan solves it"), "{stdout}");
    assert!(stderr.contains("ignored: -s 3 -g 1 -h 5 -w 2 -r 7 -E -O -C"), "{stderr}");
    let (code, ..) = speak_ff(&folder, &["--help"]);
    assert_eq!(code, Some(0));
}

#[test]
fn a_proof_with_numbers_is_not_believed_of_any_ff() {
    let place = Place::fixture("ndom", "np_unreach");
    let run = place.ff("echo 'best first search space empty! problem proven unsolvable.'", &within(10.0));
    assert_eq!(run.outcome, Outcome::GaveUp);
    assert!(run.message.contains("no proof for a task with"), "{}", run.message);
}

#[test]
fn a_limit_of_memory_is_the_reason_however_small_it_is() {
    let place = Place::new();
    for limit in [1, 5000, 1 << 20, 5 << 20, 10 << 20, 30 << 20] {
        let limits = Limits { memory: Some(limit), ..within(30.0) };
        let run = place.run(&Builtin::default(), &limits);
        assert_eq!(run.outcome, Outcome::OutOfMemory, "{limit}: {run:?}");
    }
    for limit in [60 << 20, 90 << 20, 150 << 20] {
        let run = place.run(&Builtin::default(), &Limits { memory: Some(limit), ..within(30.0) });
        assert!([0, 22].contains(&Exit::from(&run.outcome).code()), "{limit}: {run:?}");
    }
    let message = |limit| place.run(&Builtin::default(), &Limits { memory: Some(limit), ..within(30.0) }).message;
    assert_eq!(message(1), "its limit was 1 bytes");
    assert_eq!(message(20_480), "its limit was 20 KiB");
}

#[test]
fn a_quick_program_has_its_limit_from_the_start() {
    let run = Place::new().ff(FOUND, &Limits { memory: Some(1 << 20), ..within(10.0) });
    assert_eq!(run.outcome, Outcome::OutOfMemory, "{run:?}");
}

#[test]
fn a_limit_of_memory_holds_for_all_processes_together() {
    let place = Place::new();
    let pid = place.path("pid");
    let body = format!(
        "for i in 1 2 3 4; do setsid sh -c '{{ head -c 80000000 /dev/zero; sleep 60; }} | tail -c 80000000 > /dev/null' & \
         echo $! >> {}; done; wait",
        pid.display()
    );
    let started = Instant::now();
    let run = place.ff(&body, &Limits { memory: Some(250 << 20), ..within(50.0) });
    assert_eq!((run.outcome.clone(), run.message.as_str()), (Outcome::OutOfMemory, "its limit was 250 MiB"), "{run:?}");
    assert!(started.elapsed() < Duration::from_secs(40));
    for pid in fs::read_to_string(pid).unwrap().lines() {
        assert!(!lives(pid), "process {pid} is still there");
    }
}

#[test]
fn only_files_of_the_runs_own_are_read_as_plans() {
    let secret = Place::new();
    fs::write(secret.path("secret"), "(go a)\n; cost = 1 (unit cost)\n").unwrap();
    let link = format!("ln -s {} \"$3\"", secret.path("secret").display());
    for body in ["mkfifo \"$3\"", "ln -s /dev/zero \"$3\"", "mkdir \"$3\"", &link, "rm -f stdout; mkfifo stdout"] {
        let started = Instant::now();
        let run = Place::new().configured(body, Dialect::Downward, &within(10.0));
        assert_eq!(run.outcome, Outcome::NoPlan, "{body}: {run:?}");
        assert!(started.elapsed() < Duration::from_secs(8), "{body}: {:?}", started.elapsed());
    }
    let body = "printf '(go a)\\n; cost = 1 (unit cost)\\n' > best; ln -s best \"$3\"";
    assert_eq!(steps(&Place::new().configured(body, Dialect::Downward, &within(10.0))), ["Go A"]);
}

#[test]
fn a_planner_does_not_outlive_its_supervisor() {
    let place = Place::new();
    let pid = place.path("pid");
    let body = format!("sleep 600 & echo $! $$ > {}; kill -9 $PPID; sleep 600", pid.display());
    let run = place.ff(&body, &within(20.0));
    assert_eq!(run.outcome, Outcome::Failed, "{run:?}");
    for pid in fs::read_to_string(pid).unwrap().split_whitespace() {
        dies(pid);
    }
}

#[test]
fn what_was_not_found_is_told_apart() {
    let run = Place::new().ff("no-such-inner-command", &within(10.0));
    assert_eq!(run.outcome, Outcome::NotFound);
    assert!(run.message.contains("no-such-inner-command") && run.message.contains("not found"), "{}", run.message);

    let run = Place::new().ff("echo 'no licence' >&2; exit 7", &within(10.0));
    assert_eq!((run.outcome, run.message.as_str()), (Outcome::Failed, "it exited with 7: no licence"));
    assert_eq!(run.code, Some(7));
    let run = Place::new().ff("echo hello", &within(10.0));
    assert_eq!((run.outcome, run.message.as_str()), (Outcome::NoPlan, "what it returned is not a plan"));

    let run = Place::new().ff("echo 'licence missing' >&2; exit 127", &within(10.0));
    assert_eq!((run.outcome, run.message.as_str()), (Outcome::Failed, "it exited with 127: licence missing"));

    let place = Place::new();
    let program = place.script("scripted", "");
    fs::write(&program, "#!/no/such/interpreter -x\n").unwrap();
    let run = place.run(&Ff { program: program.into() }, &within(10.0));
    assert_eq!(run.outcome, Outcome::NotFound);
    assert!(run.message.contains("interpreter `/no/such/interpreter -x`"), "{}", run.message);
}

#[test]
fn an_interruption_before_the_run_keeps_the_program_from_starting() {
    let place = Place::new();
    place.interrupted.store(true, Ordering::Relaxed);
    let ran = place.path("ran");
    let run = place.ff(&format!("touch {}; {FOUND}", ran.display()), &within(10.0));
    assert_eq!(run.outcome, Outcome::Interrupted);
    assert!(!ran.exists());
}

/// Balls to be carried to another room, two at a time.
fn gripper(balls: usize) -> Place {
    let domain = "(define (domain gripper) (:requirements :strips :typing) (:types ball hand room)
      (:predicates (at ?b - ball ?r - room) (robot ?r - room) (free ?h - hand) (holds ?h - hand ?b - ball))
      (:action go :parameters (?a ?b - room) :precondition (robot ?a) :effect (and (robot ?b) (not (robot ?a))))
      (:action pick :parameters (?b - ball ?h - hand ?r - room)
        :precondition (and (at ?b ?r) (robot ?r) (free ?h))
        :effect (and (holds ?h ?b) (not (at ?b ?r)) (not (free ?h))))
      (:action drop :parameters (?b - ball ?h - hand ?r - room)
        :precondition (and (holds ?h ?b) (robot ?r))
        :effect (and (at ?b ?r) (free ?h) (not (holds ?h ?b)))))";
    let every = |text: &str| (0..balls).map(|ball| text.replace('#', &ball.to_string())).collect::<String>();
    let problem = format!(
        "(define (problem g) (:domain gripper) (:objects {} - ball l r - hand a b - room)
           (:init (robot a) (free l) (free r) {}) (:goal (and {})))",
        every("b# "),
        every("(at b# a)"),
        every("(at b# b)")
    );
    Place::with(domain, &problem)
}

#[test]
fn the_best_plan_of_an_anytime_search_is_taken_at_the_limit() {
    let place = gripper(12);
    let first = steps(&place.run(&Builtin::default(), &within(60.0)));
    let best = steps(&place.run(&Builtin { anytime: true }, &within(3.0)));
    assert!(best.len() <= first.len() && best.len() >= 35, "{} then {}", first.len(), best.len());
}

#[test]
fn an_anytime_search_ends_when_nothing_better_is_left() {
    let run = gripper(2).run(&Builtin { anytime: true }, &within(60.0));
    assert_eq!(steps(&run).len(), 5, "{run:?}");
    assert!(run.stdout.contains("found legal plan"), "{run:?}");
}

#[test]
fn the_builtin_planner_finds_the_same_plan_each_time() {
    let place = gripper(9);
    let plans: Vec<_> = (0..3).map(|_| steps(&place.run(&Builtin::default(), &within(60.0)))).collect();
    assert!(plans.windows(2).all(|pair| pair[0] == pair[1]), "{plans:?}");
}
