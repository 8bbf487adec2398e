//! `rmem restore`, killed in the middle.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use libtest_mimic::{Failed, Trial};
use rmem::store::{Role, StoreUri, open};

/// How many restores are killed; more by hand than in every run.
const KILLS: &str = "RMEM_TEST_KILLS";
/// How many documents there are before, and in the dump.
const OLD: usize = 500;
const NEW: usize = 6_000;

pub(crate) fn trials() -> Vec<Trial> {
    let trial = |name, arguments: &'static [&str]| {
        Trial::test(name, move || {
            let folder = tempfile::tempdir()?;
            killed(folder.path(), &format!("file:{}", folder.path().join("robot.rmem").display()), arguments)
        })
    };
    vec![
        trial("restores::a_killed_restore_has_put_all_documents_or_none", &[]),
        trial("restores::a_killed_restore_has_swapped_the_collections_or_not", &["--drop"]),
    ]
}

/// The same on a server, where only a swap is one step.
pub(crate) fn on_server(uri: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    killed(folder.path(), uri, &["--drop"])
}

fn rmem(folder: &Path, memory: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
    command.current_dir(folder).env("HOME", folder).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.args(["-q", "--memory", memory]).args(arguments);
    command
}

fn printed(folder: &Path, memory: &str, arguments: &[&str]) -> Result<String, Failed> {
    let output = rmem(folder, memory, arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).output()?;
    if !output.status.success() {
        return Err(format!("{arguments:?}: {output:?}").into());
    }
    Ok(String::from_utf8(output.stdout)?)
}

/// The states of a document of the old world, and of one of the new.
fn world(version: i32, count: usize) -> String {
    let documents = |from: usize| -> String {
        let document = |n| format!("{{\"_id\":{n},\"version\":{version},\"pad\":\"{}\"}}", "x".repeat(60));
        (from..from + count / 2).map(document).collect::<Vec<_>>().join(",\n")
    };
    format!("{{\"restores.a\":[\n{}\n],\n\"restores.b\":[\n{}\n]}}\n", documents(0), documents(count))
}

fn killed(folder: &Path, memory: &str, arguments: &[&str]) -> Result<(), Failed> {
    std::fs::write(folder.join("old.json"), world(1, OLD))?;
    std::fs::write(folder.join("new.json"), world(2, NEW))?;
    let whole = [&["restore", "new.json"], arguments].concat();
    let since = Instant::now();
    printed(folder, memory, &whole)?;
    let longest = since.elapsed();
    let kills = std::env::var(KILLS).ok().and_then(|text| text.parse().ok()).unwrap_or(8_u32).min(200);
    let (mut before, mut after) = (0, 0);
    for round in 0..kills {
        for collection in ["a", "b"] {
            printed(folder, memory, &["drop", &format!("restores.{collection}")])?;
        }
        printed(folder, memory, &["restore", "old.json"])?;
        let mut child = rmem(folder, memory, &whole).spawn()?;
        std::thread::sleep(
            longest.mul_f64(1.5 * f64::from(round + 1) / f64::from(kills)).max(Duration::from_millis(1)),
        );
        child.kill()?;
        child.wait()?;
        let mut states = Vec::new();
        for collection in ["restores.a", "restores.b"] {
            let of = |version| printed(folder, memory, &["count", collection, &format!("{{version: {version}}}")]);
            states.push(match (of(1)?.trim().parse::<usize>()?, of(2)?.trim().parse::<usize>()?) {
                (old, 0) if old == OLD / 2 => 1,
                // What was there before and is not in the dump stays, where collections are not dropped.
                (_, new) if new == NEW / 2 => 2,
                other => return Err(format!("round {round}: {collection} is a mixture: {other:?}").into()),
            });
        }
        match states.as_slice() {
            [1, 1] => before += 1,
            [2, 2] => after += 1,
            _ if memory.starts_with("mongodb") => after += 1,
            _ => return Err(format!("round {round}: only one collection was restored").into()),
        }
    }
    eprintln!("{kills} restores killed {arguments:?}: {before} had done nothing, {after} everything");
    printed(folder, memory, &["restore", "old.json"])?;
    let left = open(&StoreUri::parse(memory)?, Role::Local)?.collections()?;
    assert!(!left.iter().any(|ns| ns.collection.contains("restoring_")), "{left:?}");
    Ok(())
}
