//! Views in the programs that they are for: MCAP's own reader, and a terminal.

use std::path::Path;
use std::process::Command;

use libtest_mimic::{Failed, Trial};

use crate::scenes::programs::{Python, run};

/// Trials whose program is not installed are ignored.
pub(crate) fn trials() -> Vec<Trial> {
    let python = Python::find();
    let is_missing = |module: &str| !python.as_ref().is_some_and(|python| python.has(module));
    let ends = [
        ("leaves_the_terminal_as_it_was_after_q", "q", 0),
        ("leaves_the_terminal_as_it_was_after_TERM", "TERM", 130),
        ("leaves_the_terminal_as_it_was_after_INT", "INT", 130),
        ("leaves_the_terminal_as_it_was_after_HUP", "HUP", 130),
        ("leaves_the_terminal_as_it_was_after_QUIT", "QUIT", 130),
        ("leaves_the_terminal_as_it_was_while_it_is_suspended", "TSTP", 0),
        ("is_suspended_by_its_key", "ctrl-z", 0),
        ("ends_when_its_terminal_is_gone", "gone", 130),
        ("ends_when_the_terminal_of_its_session_is_gone", "gone-session", 130),
    ];
    let browsers = ends.map(|(what, end, code)| {
        Trial::test(format!("views::the_browser_{what}"), move || browse(end, code))
            .with_ignored_flag(is_missing("pty"))
    });
    let log = Trial::test("views::mcap_reads_the_messages_of_a_log", mcap_reads).with_ignored_flag(is_missing("mcap"));
    browsers.into_iter().chain([log]).collect()
}

fn rmem(folder: &Path, args: &[&str]) -> Result<String, Failed> {
    let output =
        Command::new(env!("CARGO_BIN_EXE_rmem")).args(args).current_dir(folder).env("HOME", folder).output()?;
    if !output.status.success() {
        return Err(format!("{args:?}: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    Ok(String::from_utf8(output.stdout)?)
}

fn script(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/integration").join(name).display().to_string()
}

fn browse(end: &str, code: i32) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let memory = format!("file:{}", folder.path().join("m.rmem").display());
    let insert = |args: &[&str]| rmem(folder.path(), &[&["--memory", &memory, "insert"], args].concat());
    insert(&["robmem.cups", "{name: 'cup 1'}", "{name: 'cup 2'}"])?;
    insert(&["robmem.plans", "{plan: 'success', '1': {action: 'pick-up', x: 'A', _status: 'done'}}"])?;
    drive(&[&memory, end], code)
}

/// Drives the browser by the script; checks its exit code.
fn drive(arguments: &[&str], code: i32) -> Result<(), Failed> {
    let python = Python::find().ok_or("there is no python3")?;
    let script = script("views.py");
    let printed = run(python.path(), &[&[script.as_str(), env!("CARGO_BIN_EXE_rmem")], arguments].concat())?;
    if printed.trim() == code.to_string() { Ok(()) } else { Err(format!("it ended with {printed}").into()) }
}

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried on a server.
pub(crate) const CASES: [(&str, Case); 1] = [("views::the_browser_is_live_on_mongod", live)];

fn live(uri: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    rmem(folder.path(), &["--memory", uri, "insert", "viewed.cups", "{name: 'cup 1'}", "{name: 'cup 2'}"])?;
    drive(&[uri, "q", "viewed.cups"], 0)
}

fn mcap_reads() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let kitchen = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes/kitchen.json").display().to_string();
    let args = [
        "--memory",
        "mem:",
        "--load",
        &kitchen,
        "export",
        "mcap",
        "robmem.worldmodel",
        "--time",
        "mass",
        "-o",
        "log.mcap",
    ];
    rmem(folder.path(), &args)?;
    let log = folder.path().join("log.mcap").display().to_string();
    let python = Python::find().ok_or("there is no python3")?;
    let lines = run(python.path(), &[&script("mcap_messages.py"), &log])?;
    let read: Vec<serde_json::Value> = lines.lines().map(serde_json::from_str).collect::<Result<_, _>>()?;
    let of = |topic: &str| read.iter().filter(|line| line["topic"] == topic).collect::<Vec<_>>();
    let (documents, scenes, frames) = (of("/robmem/worldmodel"), of("/robmem/worldmodel/scene"), of("/tf"));
    let cup = scenes.first().ok_or("no scene was read")?;
    let cylinder = &cup["message"]["entities"][0]["cylinders"][0];
    // Foxglove has diameters, and a quarter of a second is the time here.
    let is_right = documents.len() == 2
        && scenes.len() == 2
        && frames
            .first()
            .is_some_and(|line| line["message"]["transforms"].as_array().is_some_and(|all| all.len() == 4))
        && cup["schema"] == "foxglove.SceneUpdate"
        && cup["time"] == 250_000_000
        && cylinder["size"] == serde_json::json!({ "x": 0.08, "y": 0.08, "z": 0.1 });
    if is_right { Ok(()) } else { Err(lines.into()) }
}
