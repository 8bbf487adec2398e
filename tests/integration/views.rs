//! Views in the programs that they are for: MCAP's own reader, and a terminal.

use std::path::Path;
use std::process::Command;

use libtest_mimic::{Failed, Trial};

use crate::scenes::programs::{Python, run};

/// Trials whose program is not installed are ignored.
pub(crate) fn trials() -> Vec<Trial> {
    let python = Python::find();
    let is_missing = |module: &str| !python.as_ref().is_some_and(|python| python.has(module));
    let ends = [("q", 0), ("TERM", 130), ("INT", 130), ("HUP", 130)];
    let browsers = ends.map(|(end, code)| {
        Trial::test(format!("views::the_browser_leaves_the_terminal_as_it_was_after_{end}"), move || browse(end, code))
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
    rmem(folder.path(), &["--memory", &memory, "insert", "robmem.cups", "{name: 'cup 1'}", "{name: 'cup 2'}"])?;
    let python = Python::find().ok_or("there is no python3")?;
    let said = run(python.path(), &[&script("views.py"), env!("CARGO_BIN_EXE_rmem"), &memory, end])?;
    if said.trim() == code.to_string() { Ok(()) } else { Err(format!("it ended with {said}").into()) }
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
