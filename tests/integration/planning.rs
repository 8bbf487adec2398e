//! `rmem plan --watch` over a real mongod.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, channel};

use libtest_mimic::Failed;

use crate::watching::TIMEOUT;

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried on the server at a URI.
pub(crate) const CASES: &[(&str, Case)] = &[("planning::a_watched_plan_of_mongod_is_made_anew", made_anew)];

const GOAL: &str = "(and (on A B) (on B C))";

/// A robot in a folder of its own, whose blocks are in the database `planning`.
struct Robot<'a> {
    uri: &'a str,
    folder: tempfile::TempDir,
}

impl<'a> Robot<'a> {
    fn new(uri: &'a str) -> Result<Self, Failed> {
        let folder = tempfile::tempdir()?;
        let project = Path::new(env!("CARGO_MANIFEST_DIR"));
        let template = std::fs::read_to_string(project.join("templates/blocksworld/problem.pddl.j2"))?;
        std::fs::write(folder.path().join("problem.pddl.j2"), template.replace("robmem.", "planning."))?;
        for (file, name) in
            [("domains/blocksworld/domain.pddl", "domain.pddl"), ("fixtures/blocksworld.json", "world.json")]
        {
            std::fs::copy(project.join(file), folder.path().join(name))?;
        }
        Ok(Self { uri, folder })
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
        command.args(["--memory", self.uri]).args(arguments).current_dir(self.folder.path());
        command.env("HOME", self.folder.path()).stdin(Stdio::null());
        command
    }

    fn run(&self, arguments: &[&str]) -> Result<Output, Failed> {
        let output = self.command(arguments).output()?;
        if output.status.success() { Ok(output) } else { Err(format!("{arguments:?}: {output:?}").into()) }
    }
}

/// A `rmem plan --watch`, and what it prints and says.
struct Watched {
    child: Child,
    lines: Receiver<String>,
}

impl Watched {
    fn start(robot: &Robot<'_>) -> Result<Self, Failed> {
        let arguments = ["plan", "--watch", "-d", "domain.pddl", "-t", "problem.pddl.j2", "--goal", GOAL];
        let mut command = robot.command(&[&arguments[..], &["--into", "planning.plans"]].concat());
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
        let (sender, lines) = channel();
        let (stdout, stderr) = (child.stdout.take().ok_or("no stdout")?, child.stderr.take().ok_or("no stderr")?);
        let other = sender.clone();
        std::thread::spawn(move || {
            BufReader::new(stdout).lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        std::thread::spawn(move || {
            BufReader::new(stderr).lines().map_while(Result::ok).try_for_each(|line| other.send(line))
        });
        Ok(Self { child, lines })
    }

    /// Waits for a line with this text.
    fn until(&self, text: &str) -> Result<(), Failed> {
        let mut seen = Vec::new();
        loop {
            let line = self.lines.recv_timeout(TIMEOUT).map_err(|_| format!("no `{text}` in {seen:#?}"))?;
            if line.contains(text) {
                return Ok(());
            }
            seen.push(line);
        }
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn made_anew(uri: &str) -> Result<(), Failed> {
    let robot = Robot::new(uri)?;
    robot.run(&["restore", "world.json", "--into", "planning.worldmodel"])?;
    let watched = Watched::start(&robot)?;
    watched.until("watching planning.worldmodel")?;
    // What the plan does not care about; then a block in its way.
    robot.run(&["insert", "planning.worldmodel", "{relation: 'weather', is: 'fine'}"])?;
    let block = ["{relation: 'on', object_top: 'E', object_bottom: 'D'}", "{relation: 'clear', object: 'E'}"];
    robot.run(&[&["insert", "planning.worldmodel"], &block[..]].concat())?;
    robot.run(&["delete", "planning.worldmodel", "{relation: 'clear', object: 'D'}"])?;
    watched.until("does not hold")?;
    watched.until("(unstack E D)")?;
    watched.until("; cost")?;
    drop(watched);
    let plans = robot.run(&["count", "planning.plans"])?;
    assert_eq!(String::from_utf8(plans.stdout)?.trim(), "2", "a plan that holds is left alone");
    Ok(())
}
