//! plan --watch.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};

use super::STACKED;
use crate::lab::watch::{TIMEOUT, end, until};
use crate::lab::{Lab, TASK, rmem, root};

/// `rmem plan --watch` on the blocks world, and what it prints; killed when it is dropped.
struct Watcher {
    child: Child,
    plans: Receiver<String>,
    messages: Receiver<String>,
}

/// The lines of a pipe as they come.
fn lines(pipe: impl std::io::Read + Send + 'static) -> Receiver<String> {
    let (sender, lines) = channel();
    std::thread::spawn(move || {
        BufReader::new(pipe).lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
    });
    lines
}

impl Watcher {
    /// Starts it, and waits until it watches.
    fn new(lab: &Lab) -> Self {
        Self::with(lab, &TASK[2..])
    }

    fn with(lab: &Lab, task: &[&str]) -> Self {
        let mut command = Command::new(rmem());
        lab.isolate(&mut command);
        let command = command.args([&["plan", "--watch"], task].concat());
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let plans = lines(child.stdout.take().unwrap());
        let messages = lines(child.stderr.take().unwrap());
        let watcher = Self { child, plans, messages };
        watcher.messages_until("watching robmem.");
        watcher
    }

    /// The lines on stderr up to one with this text.
    #[track_caller]
    fn messages_until(&self, text: &str) -> Vec<String> {
        let mut lines = Vec::new();
        loop {
            lines.push(self.messages.recv_timeout(TIMEOUT).unwrap_or_else(|_| panic!("no {text}: {lines:?}")));
            if lines.last().unwrap().contains(text) {
                return lines;
            }
        }
    }

    /// The next plan that is printed.
    #[track_caller]
    fn plan(&self) -> Vec<String> {
        let mut lines = Vec::new();
        loop {
            lines.push(self.plans.recv_timeout(TIMEOUT).unwrap_or_else(|_| panic!("no whole plan: {lines:?}")));
            if lines.last().unwrap().starts_with("; cost") {
                return lines;
            }
        }
    }

    fn interrupt(mut self) -> i32 {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
        end(&mut self.child)
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_watch_plans_again_only_where_the_plan_does_not_hold() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", TASK[0], TASK[1]]).success();
    let watcher = Watcher::new(&lab);
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
    let lines = watcher.messages_until("does not hold");
    assert!(lines.last().unwrap().contains("step 2: (unstack D A)"), "{lines:?}");
    watcher.messages_until("stored in");
    let plan = watcher.plan();
    assert_eq!(plan[0], "(unstack E D)", "{plan:?}");
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "2\n");
    assert_eq!(watcher.interrupt(), 130);
}

#[test]
fn what_changes_during_a_step_is_looked_at_at_once() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", TASK[0], TASK[1]]).success();
    let watcher = Watcher::new(&lab);
    watcher.plan();
    lab.rmem(&["plan", "step", "last", "1", "--started"]).success();
    STACKED.iter().for_each(|line| drop(lab.shell(line).success()));
    let block = ["{relation: 'on', object_top: 'E', object_bottom: 'D'}", "{relation: 'clear', object: 'E'}"];
    lab.rmem(&[&["insert", "robmem.worldmodel"], &block[..]].concat()).success();
    lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'clear', object: 'D'}"]).success();
    let lines = watcher.messages_until("does not hold");
    assert!(lines.last().unwrap().contains("step 2: (unstack D A)"), "{lines:?}");
    assert_eq!(watcher.plan()[0], "(unstack E D)");
    assert_eq!(watcher.interrupt(), 130);
}

#[test]
fn a_step_that_is_done_while_the_plan_is_checked_does_not_break_it() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", TASK[0], TASK[1]]).success();
    // What the problem asks first is computed by a program that does the plan's first step, once it is told to.
    let step = STACKED.join("\n");
    let program = format!(
        "if rmdir go; then\n{step}\nrmem plan step last 1 --done\nmkdir gone\nfi >&2\necho '{{\"seen\": true}}'\n"
    );
    lab.write("camera.sh", &program);
    let camera = "[[computable]]\nname = 'camera'\ncollection = 'robmem.camera'\nspec = '{seen: true}'\n\
                  command = ['sh', 'camera.sh']\n";
    lab.write("rmem.toml", camera);
    let template = std::fs::read_to_string(root().join(TASK[5])).unwrap();
    lab.write("problem.j2", &format!("{{%- set seen = count('robmem.camera', {{'seen': true}}) -%}}\n{template}"));
    let mut task = TASK;
    task[5] = "problem.j2";
    let watcher = Watcher::with(&lab, &task[2..]);
    assert_eq!(watcher.plan()[0], "(stack B C)");
    std::fs::create_dir(lab.path().join("go")).unwrap();
    lab.rmem(&["insert", "robmem.worldmodel", "{relation: 'weather', is: 'fine'}"]).success();
    until("the step is done while the plan is checked", || lab.path().join("gone").exists());
    // What breaks it is found in the steps that are left.
    lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'clear', object: 'D'}"]).success();
    let lines = watcher.messages_until("does not hold");
    assert!(lines.last().unwrap().contains("step 2: (unstack D A)"), "{lines:?}");
    assert_eq!(watcher.interrupt(), 130);
}

#[test]
fn a_watch_follows_what_facts_are_computed_from() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.blocks", "--load", "fixtures/blocksworld-geometric.json"]).success();
    let watcher = Watcher::with(&lab, &[&["--config", "fixtures/blocksworld-geometric.toml"], &TASK[2..]].concat());
    assert_eq!(watcher.plan()[0], "(stack B C)");
    // The camera sees that D has fallen from A.
    let fallen = "{$set: {translation: [0.6, -0.2, 0.0]}}";
    lab.rmem(&["update", "robmem.blocks", "{block: 'D'}", fallen]).success();
    lab.rmem(&["update", "robmem.blocks", "{block: 'A'}", "{$set: {visible: true}}"]).success();
    watcher.messages_until("does not hold");
    assert_eq!(watcher.plan().len(), 4, "nothing has to be taken from A");
    assert_eq!(watcher.interrupt(), 130);
}

#[test]
fn a_watch_waits_for_a_world_in_which_there_is_a_plan() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", TASK[0], TASK[1]]).success();
    let watcher = Watcher::new(&lab);
    watcher.plan();
    lab.rmem(&["delete", "robmem.worldmodel", "{object: 'C'}", "--many"]).success();
    let messages = watcher.messages_until("no plan: ");
    // By the check of the plan, or by the planning after it, where the check read the memory before all was deleted.
    let said = messages.iter().filter(|line| line.contains("object `C` is not declared")).count();
    assert_eq!(said, 1, "{messages:?}");
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

#[test]
fn a_watch_waits_where_the_template_cannot_be_rendered_for_a_while() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", TASK[0], TASK[1]]).success();
    let watcher = Watcher::new(&lab);
    watcher.plan();
    lab.rmem(&["insert", "robmem.worldmodel", "{_id: 'half', relation: 'on-table'}"]).success();
    watcher.messages_until("no plan: ");
    lab.rmem(&["delete", "robmem.worldmodel", "{_id: 'half'}"]).success();
    watcher.plan();
    assert_eq!(watcher.interrupt(), 130);
}

#[test]
fn a_watch_ends_where_nobody_reads_its_plans() {
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", TASK[0], TASK[1]]).success();
    let words: Vec<String> = TASK[2..].iter().map(|word| format!("'{word}'")).collect();
    let run = lab.shell(&format!("rmem plan --watch {} | head -n 1; echo ${{PIPESTATUS[0]}}", words.join(" ")));
    assert_eq!(run.stdout, "(stack B C)\n0\n", "{run}");
}
