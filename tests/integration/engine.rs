//! Three engines of CLIPS, each a process, that keep one world model.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use libtest_mimic::{Failed, Trial};

use super::processes::until;

const FILE: &str = "engine::three_engines_on_one_file_keep_one_world_model";
#[cfg(feature = "mongodb")]
const SET: &str = "engine::three_engines_on_a_replica_set_keep_one_world_model";

/// How many changes each engine makes.
const CHANGES: &str = "RMEM_TEST_ENGINE_CHANGES";
/// The last change of the world.
const END: &str = "{_id: 1, relation: 'thing', name: 'the end', n: 0, share: 0.5, tag: 'end', list: [], 'sync-id': 1}";

/// An engine that changes the world at random, and saves its facts when it receives the last change.
const PROGRAM: &str = r#"
(deftemplate thing
  (slot name) (slot n (type INTEGER)) (slot share (type FLOAT)) (slot tag) (multislot list)
  (slot sync-id (type INTEGER) (default 0)))
(deftemplate steps (slot left (type INTEGER)))
(deffacts steps (steps (left CHANGES)))

(defrule listen
  (declare (salience 100))
  =>
  (seed SEED)
  (rm-trigger-register syncedrobmem.control "{go: 1}" go)
  (save-facts "ready"))

(defrule step
  (go)
  ?s <- (steps (left ?left&:(> ?left 0)))
  =>
  (modify ?s (left (- ?left 1)))
  (bind ?things (find-all-facts ((?f thing)) TRUE))
  (bind ?count (length$ ?things))
  (bind ?f (if (> ?count 0) then (nth$ (random 1 ?count) ?things) else FALSE))
  (bind ?r (random 1 100))
  (if (or (< ?count 5) (< ?r 20))
    then (synced-assert (str-cat "(thing (name \"t " (random 1 99) "\") (n " (random 0 9) ") (share 0.5) (tag green) (list a))"))
    else (if (< ?r 35) then (synced-modify ?f n (random 0 1000) share (/ (random 1 1000) 8))
    else (if (< ?r 50) then (synced-modify ?f tag (nth$ (random 1 4) (create$ red "red" 3 "a \"b\"")))
    else (if (< ?r 70) then (synced-add-to-multifield ?f list (random 1 5))
    else (if (< ?r 85) then (synced-remove-from-multifield ?f list (random 1 5))
    else (synced-retract ?f)))))))

(defrule done
  (steps (left 0))
  =>
  (rm-insert syncedrobmem.control "{done: 1}"))

(defrule end
  (declare (salience 50))
  (thing (sync-id 1))
  =>
  (save-facts "saved")
  (exit 0))
"#;

/// Without CLIPS inside, the trials are there, ignored.
pub(crate) fn trials() -> Vec<Trial> {
    vec![Trial::test(FILE, on_a_file).with_ignored_flag(!cfg!(feature = "clips-engine"))]
}

/// The names of the tests that need a mongod.
#[cfg(feature = "mongodb")]
pub(crate) fn names() -> Vec<String> {
    vec![SET.to_owned()]
}

#[cfg(feature = "mongodb")]
pub(crate) fn servers(program: Option<&Path>) -> Vec<Trial> {
    let ignored = program.is_none() || !cfg!(feature = "clips-engine");
    let program = program.map(Path::to_owned);
    let run = move || on_a_set(program.as_deref().ok_or("there is no mongod")?);
    vec![Trial::test(SET, run).with_ignored_flag(ignored)]
}

fn changes() -> u64 {
    std::env::var(CHANGES).ok().and_then(|text| text.parse().ok()).unwrap_or(150)
}

/// Three engines, and rmem as each of them would call it.
struct Engines<'a> {
    folders: Vec<PathBuf>,
    command: Box<dyn Fn(usize) -> Command + 'a>,
    running: Vec<Child>,
}

impl Drop for Engines<'_> {
    fn drop(&mut self) {
        for child in &mut self.running {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

impl Engines<'_> {
    /// Starts an engine, and waits until it listens.
    fn start(&self, nth: usize, seed: u32, more: &[&str]) -> Result<Child, Failed> {
        let folder = &self.folders[nth];
        let program = PROGRAM.replace("CHANGES", &changes().to_string()).replace("SEED", &seed.to_string());
        fs::write(folder.join("agent.clp"), program)?;
        let _ = fs::remove_file(folder.join("ready"));
        let mut child = (self.command)(nth)
            .args(["clips", "run", "agent.clp", "--sync", "--timeout", "5m"])
            .args(more)
            .stdout(Stdio::null())
            .stderr(fs::File::create(folder.join(format!("stderr-{seed}")))?)
            .spawn()?;
        let ready = until("an engine listens", || Ok(folder.join("ready").exists() || child.try_wait()?.is_some()));
        if ready.is_err() || !folder.join("ready").exists() {
            let _ = child.kill();
            let printed = fs::read_to_string(folder.join(format!("stderr-{seed}")))?;
            return Err(format!("engine {nth} does not start: {printed}").into());
        }
        Ok(child)
    }

    fn rmem(&self, nth: usize, args: &[&str]) -> Result<String, Failed> {
        let output = (self.command)(nth).args(args).output()?;
        if !output.status.success() {
            return Err(format!("{args:?}: {}", String::from_utf8_lossy(&output.stderr)).into());
        }
        Ok(String::from_utf8(output.stdout)?)
    }

    /// The facts of the world that an engine saved.
    fn saved(&self, nth: usize) -> Result<BTreeSet<String>, Failed> {
        let text = fs::read_to_string(self.folders[nth].join("saved"))?;
        Ok(text.lines().filter(|line| line.starts_with("(thing")).map(str::to_owned).collect())
    }

    fn count(&self, query: &str) -> Result<u64, Failed> {
        Ok(self.rmem(0, &["count", "syncedrobmem.control", query])?.trim().parse()?)
    }

    /// Lets all change the world, kills one and starts it again, and compares what they have in the end.
    fn keep_one_world(mut self) -> Result<(), Failed> {
        for nth in 0..3 {
            let seed = u32::try_from(nth)? + 1;
            let child = self.start(nth, seed, &[])?;
            self.running.push(child);
        }
        self.rmem(0, &["insert", "syncedrobmem.control", "{go: 1}"])?;
        // In the middle of it.
        until("facts are shared", || Ok(self.rmem(0, &["count", "syncedrobmem.clipswm"])?.trim() != "0"))?;
        self.running[2].kill()?;
        self.running[2].wait()?;
        fs::write(self.folders[2].join("go.txt"), "(go)\n")?;
        self.running[2] = self.start(2, 9, &["--facts", "go.txt"])?;
        until("all changes are made", || Ok(self.count("{done: 1}")? >= 3))?;
        // All receive the changes in one order, this one behind those of the engines.
        self.rmem(0, &["insert", "syncedrobmem.clipswm", END])?;
        for (nth, child) in self.running.iter_mut().enumerate() {
            let mut code = None;
            until("an engine ends", || {
                code = child.try_wait()?;
                Ok(code.is_some())
            })?;
            if code.is_none_or(|code| !code.success()) {
                return Err(format!("engine {nth} ended with {code:?}").into());
            }
        }
        let exported = ["clips", "export", "syncedrobmem.clipswm", "--deftemplates", "agent.clp"];
        let memory: BTreeSet<String> = self.rmem(0, &exported)?.lines().map(str::to_owned).collect();
        for nth in 0..3 {
            let saved = self.saved(nth)?;
            if saved != memory {
                let only = |a: &BTreeSet<String>, b: &BTreeSet<String>| {
                    a.difference(b).cloned().collect::<Vec<_>>().join("\n")
                };
                let reported = format!(
                    "only in the engine:\n{}\nonly in the memory:\n{}",
                    only(&saved, &memory),
                    only(&memory, &saved)
                );
                return Err(format!("engine {nth} differs from the memory\n{reported}").into());
            }
        }
        if memory.len() < 3 {
            return Err(format!("too little is left to compare: {memory:?}").into());
        }
        for seed in [1, 2, 9] {
            let nth = if seed == 9 { 2 } else { seed - 1 };
            let printed = fs::read_to_string(self.folders[nth].join(format!("stderr-{seed}")))?;
            if printed.contains("[RMEM") {
                return Err(format!("engine {nth} complained: {printed}").into());
            }
        }
        Ok(())
    }
}

fn on_a_file() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let folders: Vec<PathBuf> = (0..3).map(|nth| folder.path().join(format!("r{nth}"))).collect();
    folders.iter().try_for_each(fs::create_dir)?;
    let memory = format!("file:{}", folder.path().join("m.rmem").display());
    let places = folders.clone();
    let command = move |nth: usize| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
        let folder: &PathBuf = &places[nth];
        command.args(["--memory", &memory]).current_dir(folder).env("HOME", folder).stdin(Stdio::null());
        command
    };
    Engines { folders, command: Box::new(command), running: Vec::new() }.keep_one_world()
}

#[cfg(feature = "mongodb")]
fn on_a_set(mongod: &Path) -> Result<(), Failed> {
    let robots = crate::backend::Robots::new(mongod, 3)?;
    (0..3).try_for_each(|robot| robots.settle(robot, 3))?;
    robots.together(&[0, 1, 2], &["backend", "up", "--wait", "90s"])?;
    let folders = (0..3).map(|robot| robots.path(robot)).collect();
    let command = |nth: usize| robots.command(nth, &[]);
    Engines { folders, command: Box::new(command), running: Vec::new() }.keep_one_world()
}
