//! The planning benchmarks, where there are any: each problem goes into a memory and comes out equal.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use libtest_mimic::{Failed, Trial};
use rmem::formats::Source;
use rmem::formats::pddl::{Dialect, ast, read_problem};

#[path = "../unit/content.rs"]
mod content;

/// One trial; without a folder of benchmarks in `RMEM_TEST_BENCHMARKS` it is ignored.
pub(crate) fn trials() -> Vec<Trial> {
    let folder = std::env::var_os("RMEM_TEST_BENCHMARKS").map(PathBuf::from);
    let is_missing = folder.is_none();
    let work = move || folder.as_deref().map_or(Ok(()), all);
    vec![Trial::test("imported::benchmark_problems_are_made_again", work).with_ignored_flag(is_missing)]
}

fn all(folder: &Path) -> Result<(), Failed> {
    let mut count = 0;
    for entry in fs::read_dir(folder)? {
        let problem = entry?.path().join("problem.pddl");
        if problem.is_file() {
            round(&problem).map_err(|wrong| format!("{}: {wrong}", problem.display()))?;
            count += 1;
        }
    }
    if count == 0 { Err("there are no problems".into()) } else { Ok(()) }
}

fn round(problem: &Path) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let memory = format!("file:{}", folder.path().join("robot.rmem").display());
    let template = folder.path().join("t.j2").display().to_string();
    let path = problem.display().to_string();
    rmem(&["import-problem", &path, "--into", "lab.task", "--template", &template, "--lenient", "--memory", &memory])?;
    let made = rmem(&["gen-problem", "--template", &template, "--memory", &memory])?;
    let text = fs::read_to_string(problem).map_err(|error| error.to_string())?;
    if content::content(&read(&made)?) == content::content(&read(&text)?) {
        Ok(())
    } else {
        Err("the problem that was made says something else".to_owned())
    }
}

fn rmem(args: &[&str]) -> Result<String, String> {
    let output = Command::new(env!("CARGO_BIN_EXE_rmem")).args(args).output().map_err(|error| error.to_string())?;
    match output.status.success() {
        true => Ok(String::from_utf8_lossy(&output.stdout).into_owned()),
        false => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
    }
}

fn read(text: &str) -> Result<ast::Problem, String> {
    read_problem(&Source::new("problem", text), Dialect { lenient: true }).map_err(|error| error.to_string())
}
