//! plan list and the other commands about stored plans.

use crate::lab::{Lab, TASK, plan};

/// The world in which the blocks are stacked by hand, one action at a time.
const STACKED: [&str; 3] = [
    "rmem update robmem.worldmodel \"{relation: 'holding'}\" \"{\\$set: {relation: 'on', object_top: 'B', object_bottom: 'C'}, \\$unset: {object: 1}}\"",
    "rmem delete robmem.worldmodel \"{relation: 'clear', object: 'C'}\"",
    "rmem insert robmem.worldmodel \"{relation: 'clear', object: 'B'}\" \"{relation: 'hand-empty'}\"",
];

#[test]
fn a_plan_holds_until_the_world_changes_under_it() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    let run = lab.rmem(&["plan", "check", "last"]).exits(0);
    assert!(run.stdout.ends_with("holds: 5 of 5 steps are left\n") && run.stderr.is_empty(), "{run}");
    // Its first step is (stack B C): done in the world and noted, the rest still holds.
    STACKED.iter().for_each(|line| drop(lab.shell(line).success()));
    lab.rmem(&["plan", "check", "last"]).exits(1);
    lab.rmem(&["plan", "step", "last", "1", "--done"]).success();
    let run = lab.rmem(&["plan", "check", "last"]).exits(0);
    assert!(run.stdout.ends_with("holds: 4 of 5 steps are left\n"), "{run}");
    // Somebody puts a block where the next step needs a clear one.
    lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'clear', object: 'D'}"]).success();
    let run = lab.rmem(&["plan", "check", "last"]).exits(1);
    assert!(run.stdout.contains("step 2: (unstack D A) cannot be taken: (clear D) is false"), "{run}");
    assert!(run.stdout.contains("problem.pddl.j2:18: nothing in the memory says so"), "{run}");
    let json = lab.rmem(&["plan", "check", "last", "--format", "json"]).exits(1).stdout;
    let verdict: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(verdict["step"], 2);
    assert_eq!(verdict["missing"], serde_json::json!(["(clear D)"]));
    assert_eq!((&verdict["left"], &verdict["holds"]), (&4.into(), &false.into()));
    // What would mend it is said as well.
    assert_eq!(verdict["repairs"][0]["condition"], "(clear D)");
    assert!(verdict["repairs"][0]["remedies"].as_array().is_some_and(|remedies| !remedies.is_empty()), "{verdict}");
}

#[test]
fn what_should_not_be_true_is_named_with_its_document() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :negative-preconditions) (:predicates (wet ?x) (done ?x))
         (:action go :parameters (?x) :precondition (not (wet ?x)) :effect (done ?x)))",
    );
    lab.write(
        "p.j2",
        "(define (problem p) (:domain d) (:objects a)\n (:init\n{% for f in query('lab.wet') %}\n(wet {{ f.place }})\n{% endfor %})\n (:goal (done a)))",
    );
    lab.rmem(&["plan", "-d", "d.pddl", "-t", "p.j2"]).success();
    lab.rmem(&["insert", "lab.wet", "{_id: 7, place: 'a'}"]).success();
    let run = lab.rmem(&["plan", "check", "last"]).exits(1);
    assert!(run.stdout.contains("p.j2:4:1: (wet a) is in the memory"), "{run}");
    assert!(run.stdout.contains("document _id 7 of lab.wet"), "{run}");
}

#[test]
fn a_plan_whose_objects_are_gone_does_not_hold() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    lab.rmem(&["delete", "robmem.worldmodel", "{object: 'C'}", "--many"]).success();
    let run = lab.rmem(&["plan", "check", "last"]).exits(1);
    assert!(run.stdout.contains("cannot be instantiated any more") && run.stdout.contains("C"), "{run}");
}

#[test]
fn the_plan_of_a_problem_file_is_checked_against_the_state_that_is_given() {
    let lab = Lab::new();
    lab.write("p.pddl", &lab.rmem(&[&["gen-problem"], &TASK[..2], &TASK[4..]].concat()).success());
    lab.rmem(&["plan", "-d", "domains/blocksworld/domain.pddl", "-p", "p.pddl", "-q"]).success();
    let run = lab.rmem(&["plan", "check", "last"]).exits(0);
    assert!(run.stderr.contains("--problem"), "{run}");
    STACKED.iter().for_each(|line| drop(lab.shell(line).success()));
    lab.rmem(&["plan", "step", "last", "next", "--done"]).success();
    let line = "rmem gen-problem -q -t templates/blocksworld/problem.pddl.j2 --goal '(and (on A B) (on B C))' \
                | rmem plan check last --problem -";
    assert!(lab.shell(line).success().contains("4 of 5"));
}

#[test]
fn steps_are_noted_with_their_times() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    for (step, state) in [("1", "--started"), ("1", "--done"), ("next", "--started"), ("3", "--failed")] {
        lab.rmem(&["plan", "step", "last", step, state]).success();
    }
    let stored = lab.rmem(&["query", "robmem.plans"]).success();
    let document: serde_json::Value = serde_json::from_str(stored.trim()).unwrap();
    let status = |step: &str| document[step]["_status"].clone();
    assert_eq!((status("1"), status("2"), status("3")), ("done".into(), "running".into(), "failed".into()));
    assert!(document["1"]["_started"]["$date"].is_string() && document["1"]["_ended"]["$date"].is_string());
    assert!(document["2"]["_ended"].is_null() && document["4"]["_status"].is_null(), "{stored}");
    let text = lab.rmem(&["plan", "show", "last"]).success();
    assert!(
        text.starts_with("(stack B C) ; done\n(unstack D A) ; running\n(putdown D) ; failed\n(pickup A)\n"),
        "{text}"
    );
    lab.rmem(&["plan", "step", "last", "3", "--open"]).success();
    assert!(!lab.rmem(&["query", "robmem.plans"]).success().contains("failed"));
    for wrong in ["0", "6", "x", "-1"] {
        lab.rmem(&["plan", "step", "last", "--done", "--", wrong]).exits(2);
    }
    lab.rmem(&["plan", "step", "last", "1"]).exits(2);
}

#[test]
fn steps_of_the_other_layout_are_noted_too() {
    let lab = Lab::new();
    plan(&lab, &["-q", "--layout", "fawkes"]).success();
    lab.rmem(&["plan", "step", "last", "2", "--done", "--out-of-order"]).success();
    let stored = lab.rmem(&["query", "robmem.plans", "{'actions.1.status': 'done'}"]).success();
    assert!(stored.contains("\"ended\""), "{stored}");
    assert!(lab.rmem(&["plan", "show", "last", "--format", "clips"]).success().contains("(status FINAL)"));
}

#[test]
fn a_stored_plan_is_shown_in_every_format() {
    let lab = Lab::new();
    let text = plan(&lab, &["-q"]).success();
    assert_eq!(lab.rmem(&["plan", "show", "last"]).success(), text);
    for (format, mark) in [
        ("json", "{\"id\":"),
        ("document", "{\"_id\":"),
        ("dot", "digraph"),
        ("svg", "<svg "),
        ("clips", "(name stack) (arguments B C) (status FORMULATED))"),
        ("ff", "step    0: stack B C"),
    ] {
        let shown = lab.rmem(&["plan", "show", "last", "--format", format]).success();
        assert!(shown.contains(mark), "{format}: {shown}");
    }
}

#[test]
fn a_plan_is_found_by_its_id_or_the_beginning_of_it() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    plan(&lab, &["-q", "--into", "lab.plans"]).success();
    let list = lab.rmem(&["plan", "list", "--in", "lab.plans"]).success();
    let listed: serde_json::Value = serde_json::from_str(list.trim()).unwrap();
    let id = listed["_id"]["$oid"].as_str().unwrap();
    for id in [id, &id[..20]] {
        lab.rmem(&["plan", "show", id, "--in", "lab.plans"]).success();
    }
    lab.rmem(&["plan", "show", id]).exits(2);
    plan(&lab, &["-q"]).success();
    let run = lab.rmem(&["plan", "show", &id[..6]]).exits(2);
    assert!(run.stderr.contains("several plans"), "{run}");
    assert!(lab.rmem(&["plan", "show", "nosuch"]).exits(2).stderr.contains("rmem plan list"));
    assert!(lab.rmem(&["plan", "show", "last", "--in", "lab.none"]).exits(2).stderr.contains("no plan in lab.none"));
}

#[test]
fn why_tells_where_a_plan_comes_from() {
    let lab = Lab::new();
    std::fs::copy(crate::lab::root().join("domains/blocksworld/domain.pddl"), lab.path().join("d.pddl")).unwrap();
    lab.rmem(&["plan", "-q", TASK[0], TASK[1], "-d", "d.pddl", TASK[4], TASK[5], "--goal", "(on A B)"]).success();
    let told = lab.rmem(&["plan", "why", "last"]).success();
    for part in [
        "goal        (on A B)",
        "domain      d.pddl (sha256 ",
        "template    templates/blocksworld/problem.pddl.j2 (sha256 ",
        "planner     builtin ferroplan",
        "in robmem.worldmodel: 2 documents",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
    lab.write("d.pddl", "another");
    assert!(lab.rmem(&["plan", "why", "last"]).success().contains("the file is another now"));
}

#[test]
fn no_address_of_a_memory_is_kept_with_a_plan() {
    let lab = Lab::new();
    lab.rmem(&[&["plan", "-q", "--memory", "file:secret-name.rmem"], &TASK[..]].concat()).success();
    let stored = lab.rmem(&["query", "robmem.plans", "--meta", "--memory", "file:secret-name.rmem"]).success();
    assert!(stored.contains("\"sources\"") && !stored.contains("secret-name"), "{stored}");
}

#[test]
fn a_plan_from_a_file_is_stored_if_it_is_valid() {
    let lab = Lab::new();
    let text = plan(&lab, &["-q", "--no-store"]).success();
    lab.write("ipc.plan", &text);
    lab.write(
        "ff.plan",
        &plan(&lab, &["-q", "--no-store", "--format", "ff"])
            .success()
            .to_uppercase()
            .replace("FF: FOUND LEGAL PLAN AS FOLLOWS", "ff: found legal plan as follows")
            .replace("STEP", "step"),
    );
    for file in ["ipc.plan", "ff.plan"] {
        let id = lab.rmem(&[&["plan", "import", file], &TASK[2..]].concat()).success();
        assert_eq!(lab.rmem(&["plan", "show", id.trim()]).success(), text);
        assert!(lab.rmem(&["plan", "why", "last"]).success().contains(&format!("command     {file}")));
    }
    lab.write("bad.plan", &text.lines().skip(1).collect::<Vec<_>>().join("\n"));
    let run = lab.rmem(&[&["plan", "import", "bad.plan"], &TASK[2..]].concat()).exits(1);
    assert!(run.stderr.contains("step 1"), "{run}");
    lab.write("no.plan", "(stack B");
    lab.rmem(&[&["plan", "import", "no.plan"], &TASK[2..]].concat()).exits(3);
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "2\n");
}

#[test]
fn a_temporal_plan_from_a_file_is_stored_and_drawn() {
    let lab = Lab::new();
    let task = ["-d", "fixtures/pddl/tasks/durdom.pddl", "-p", "fixtures/pddl/tasks/durp.pddl"];
    let text = lab.rmem(&[&["plan", "--no-store", "-q"], &task[..]].concat()).success();
    lab.write("t.plan", &text);
    lab.rmem(&[&["plan", "import", "t.plan"], &task[..]].concat()).success();
    assert_eq!(lab.rmem(&["plan", "show", "last"]).success(), text);
    assert!(lab.rmem(&["plan", "show", "last", "--format", "svg"]).success().contains("<rect"));
    lab.rmem(&["plan", "check", "last"]).exits(0);
}

#[test]
fn a_rerun_plans_the_same_task_in_the_world_of_now() {
    let lab = Lab::new();
    plan(&lab, &["-q", "--timeout", "50s"]).success();
    STACKED.iter().for_each(|line| drop(lab.shell(line).success()));
    lab.rmem(&["plan", "check", "last"]).exits(1);
    let text = lab.rmem(&["plan", "rerun", "last", "-q"]).success();
    assert!(text.starts_with("(unstack D A)\n") && text.ends_with("; cost = 4 (unit cost)\n"), "{text}");
    let told = lab.rmem(&["plan", "why", "last"]).success();
    assert!(told.contains("rerun of") && told.contains("timeout     50000 ms"), "{told}");
    lab.rmem(&["plan", "check", "last"]).exits(0);
}

#[test]
fn numbers_that_are_names_come_back_as_numbers() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:predicates (at ?x) (done ?x)) (:action go :parameters (?x) :precondition (at ?x) :effect (done ?x)))",
    );
    let template = |name: &str| {
        format!(
            "(define (problem p) (:domain d) (:objects {{% for o in query('lab.o') %}}{{{{ o.n{name} }}}} {{% endfor %}})
             (:init {{% for o in query('lab.o') %}}(at {{{{ o.n{name} }}}}) {{% endfor %}})
             (:goal (and {{% for o in query('lab.o') %}}(done {{{{ o.n{name} }}}}) {{% endfor %}})))"
        )
    };
    lab.write("plain.j2", &template(""));
    lab.write("named.j2", &template("|name"));
    lab.write(
        "markers",
        "(define (problem p) (:domain d) (:objects <<#A|{}>><<n>> <</A>>) (:init <<#A>>(at <<n>>) <</A>>) (:goal (and <<#A>>(done <<n>>) <</A>>)))",
    );
    let values = ["5", "NumberLong(7)", "2.5", "'8'", "'B 1'"];
    for value in values {
        lab.rmem(&["insert", "lab.o", &format!("{{n: {value}}}")]).success();
    }
    for template in ["plain.j2", "named.j2", "markers"] {
        lab.rmem(&["plan", "-d", "d.pddl", "-t", template, "--collection", "lab.o"]).success();
        let stored = lab.rmem(&["query", "robmem.plans", "--format", "canonical", "--sort", "{_id: -1}"]).success();
        let newest = stored.lines().next().unwrap();
        for value in
            ["{\"$numberInt\":\"5\"}", "{\"$numberLong\":\"7\"}", "{\"$numberDouble\":\"2.5\"}", "\"8\"", "\"B 1\""]
        {
            assert!(newest.contains(&format!("\"x\":{value}}}")), "{template}: {value}: {newest}");
        }
        lab.rmem(&["plan", "check", "last"]).exits(0);
        lab.rmem(&["drop", "robmem.plans"]).success();
    }
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

/// `rmem plan --watch` on the blocks world, and what it prints.
struct Watcher {
    child: std::process::Child,
    told: std::io::Lines<std::io::BufReader<std::process::ChildStdout>>,
    said: std::io::Lines<std::io::BufReader<std::process::ChildStderr>>,
}

impl Watcher {
    /// Starts it, and waits until it watches.
    fn new(lab: &Lab) -> Self {
        Self::with(lab, &[])
    }

    fn with(lab: &Lab, more: &[&str]) -> Self {
        use std::io::{BufRead as _, BufReader};
        let mut command = std::process::Command::new(crate::lab::rmem());
        lab.isolate(&mut command);
        let command = command.args([&["plan", "--watch"], &TASK[2..], more].concat());
        let pipes = command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
        let mut child = pipes.spawn().unwrap();
        let told = BufReader::new(child.stdout.take().unwrap()).lines();
        let said = BufReader::new(child.stderr.take().unwrap()).lines();
        let mut watcher = Self { child, told, said };
        assert_eq!(watcher.said_until("watching").last().unwrap(), "watching robmem.worldmodel");
        watcher
    }

    /// The lines on stderr up to one with this text.
    fn said_until(&mut self, text: &str) -> Vec<String> {
        let mut lines = Vec::new();
        loop {
            lines.push(self.said.next().unwrap_or_else(|| panic!("no {text}: {lines:?}")).unwrap());
            if lines.last().unwrap().contains(text) {
                return lines;
            }
        }
    }

    /// The next plan that is printed.
    fn plan(&mut self) -> Vec<String> {
        let mut lines = Vec::new();
        loop {
            lines.push(self.told.next().unwrap().unwrap());
            if lines.last().unwrap().starts_with("; cost") {
                return lines;
            }
        }
    }

    fn interrupt(mut self) -> i32 {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
        self.child.wait().unwrap().code().unwrap()
    }
}

#[test]
fn a_watch_plans_again_only_where_the_plan_does_not_hold() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", TASK[0], TASK[1]]).success();
    let mut watcher = Watcher::new(&lab);
    assert_eq!(watcher.plan().len(), 6);
    // What the plan does not care about, and a step that is begun, done and noted: it still holds.
    lab.rmem(&["insert", "robmem.worldmodel", "{relation: 'weather', is: 'fine'}"]).success();
    lab.rmem(&["plan", "step", "last", "1", "--started"]).success();
    STACKED.iter().for_each(|line| drop(lab.shell(line).success()));
    lab.rmem(&["plan", "step", "last", "1", "--done"]).success();
    // Now a new block lies on D, which the next step wants to take.
    let block = ["{relation: 'on', object_top: 'E', object_bottom: 'D'}", "{relation: 'clear', object: 'E'}"];
    lab.rmem(&[&["insert", "robmem.worldmodel"], &block[..]].concat()).success();
    lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'clear', object: 'D'}"]).success();
    let lines = watcher.said_until("does not hold");
    assert!(lines.last().unwrap().contains("step 2: (unstack D A)"), "{lines:?}");
    watcher.said_until("stored in");
    let plan = watcher.plan();
    assert_eq!(plan[0], "(unstack E D)", "{plan:?}");
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "2\n");
    assert_eq!(watcher.interrupt(), 130);
}

#[test]
fn what_changes_during_a_step_is_looked_at_when_it_has_ended() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", TASK[0], TASK[1]]).success();
    let mut watcher = Watcher::new(&lab);
    watcher.plan();
    lab.rmem(&["plan", "step", "last", "1", "--started"]).success();
    STACKED.iter().for_each(|line| drop(lab.shell(line).success()));
    let block = ["{relation: 'on', object_top: 'E', object_bottom: 'D'}", "{relation: 'clear', object: 'E'}"];
    lab.rmem(&[&["insert", "robmem.worldmodel"], &block[..]].concat()).success();
    lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'clear', object: 'D'}"]).success();
    // Longer than a watch waits for quiet.
    std::thread::sleep(std::time::Duration::from_millis(700));
    lab.rmem(&["plan", "step", "last", "1", "--done"]).success();
    watcher.said_until("does not hold");
    assert_eq!(watcher.plan()[0], "(unstack E D)");
    assert_eq!(watcher.interrupt(), 130);
}

#[test]
fn a_watch_hears_of_what_facts_are_computed_from() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.blocks", "--load", "fixtures/blocksworld-geometric.json"]).success();
    let mut watcher = Watcher::with(&lab, &["--config", "fixtures/blocksworld-geometric.toml"]);
    assert_eq!(watcher.plan()[0], "(stack B C)");
    // The camera sees that D has fallen from A.
    let fallen = "{$set: {translation: [0.6, -0.2, 0.0]}}";
    lab.rmem(&["update", "robmem.blocks", "{block: 'D'}", fallen]).success();
    lab.rmem(&["update", "robmem.blocks", "{block: 'A'}", "{$set: {visible: true}}"]).success();
    watcher.said_until("does not hold");
    assert_eq!(watcher.plan().len(), 4, "nothing has to be taken from A");
    assert_eq!(watcher.interrupt(), 130);
}

#[test]
fn a_watch_waits_for_a_world_in_which_there_is_a_plan() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", TASK[0], TASK[1]]).success();
    let mut watcher = Watcher::new(&lab);
    watcher.plan();
    lab.rmem(&["delete", "robmem.worldmodel", "{object: 'C'}", "--many"]).success();
    watcher.said_until("no plan: ");
    lab.rmem(&[
        "insert",
        "robmem.worldmodel",
        "{relation: 'on-table', object: 'C'}",
        "{relation: 'clear', object: 'C'}",
    ])
    .success();
    assert_eq!(watcher.plan().len(), 6);
    assert_eq!(watcher.interrupt(), 130);
}
