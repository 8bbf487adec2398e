//! The example of an executive that uses pymongo alone: the same program on `rmem serve` and on a replica set.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use libtest_mimic::{Failed, Trial};

use super::Served;
use crate::mongod::Mongod;
use crate::scenes::programs::Python;

const ON_SERVE: &str = "serving::a_python_executive_with_pymongo_alone_executes_what_is_planned";
const ON_MONGOD: &str = "serving::the_same_executive_runs_unchanged_on_a_replica_set";

/// The names of the trials that need a server.
pub(crate) fn names() -> Vec<String> {
    vec![ON_MONGOD.to_owned()]
}

/// The trials are ignored where pymongo is not installed, or where there is no mongod.
pub(crate) fn trials(program: Option<&Path>) -> Vec<Trial> {
    let has_pymongo = Python::find().is_some_and(|python| python.has("pymongo"));
    let missing = program.is_none();
    let program = program.map(Path::to_owned);
    let on_mongod = move || on_mongod(program.as_deref().ok_or("there is no mongod")?);
    vec![
        Trial::test(ON_SERVE, on_serve).with_ignored_flag(!has_pymongo),
        Trial::test(ON_MONGOD, on_mongod).with_ignored_flag(!has_pymongo || missing),
    ]
}

fn on_serve() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let file = format!("file:{}", folder.path().join("robot.rmem").display());
    execute(folder.path(), &file, &served.uri)
}

fn on_mongod(program: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mongod = Mongod::start(program)?;
    execute(folder.path(), &mongod.uri, &mongod.uri)
}

/// Plans and executes on a memory that pymongo finds at a URI.
fn execute(folder: &Path, memory: &str, uri: &str) -> Result<(), Failed> {
    let python = Python::find().ok_or("there is no python3")?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let rmem = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
        command.args(["--memory", memory]).args(arguments).current_dir(root).env("HOME", folder).stdin(Stdio::null());
        command
    };
    let count = |filter: &str| -> Result<String, Failed> {
        Ok(String::from_utf8(rmem(&["count", "robmem.worldmodel", filter]).output()?.stdout)?)
    };
    let load = ["count", "robmem.worldmodel", "--load", "fixtures/blocksworld.json"];
    succeed(&rmem(&load).output()?)?;
    let watch = ["plan", "--watch", "--domain", "domains/blocksworld/domain.pddl"];
    let goal = ["--template", "templates/blocksworld/problem.pddl.j2", "--goal", "(and (on A B) (on B C))"];
    let mut planner = rmem(&[watch.as_slice(), &goal].concat()).stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
    let script = root.join("examples/python/pymongo_executive.py");
    let executed = Command::new(python.path()).arg(script).args([uri, "100"]).env("HOME", folder).output();
    planner.kill()?;
    planner.wait()?;
    let executed = executed?;
    let printed = String::from_utf8(executed.stdout.clone())?;
    succeed(&executed)?;
    // A new plan may be stored while one is executed; what was done is the same.
    let done: Vec<&str> = printed.lines().filter(|line| line.starts_with("did ")).collect();
    assert_eq!(done, ["did stack B C", "did unstack D A", "did putdown D", "did pickup A", "did stack A B"]);
    assert_eq!(count("{relation: 'on', object_top: {$in: ['A', 'B']}}")?, "2\n");
    assert_eq!(count("{relation: 'holding'}")?, "0\n");
    Ok(())
}

fn succeed(output: &Output) -> Result<(), Failed> {
    match output.status.success() {
        true => Ok(()),
        false => {
            Err(format!("{:?}: {}", output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned()).into())
        }
    }
}
