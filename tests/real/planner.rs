//! The real `ff` and `fast-downward`, where they are on the path.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use libtest_mimic::{Failed, Trial};
use rmem::exit::Exit;
use rmem::formats::Source;
use rmem::formats::pddl::Dialect;
use rmem::pddl::{Domain, Problem};
use rmem::planner::{Host, Limits, Run, Task, by_name, run};

/// Task, and the exit code of its outcome.
const OUTCOMES: [(&str, &str, u8); 8] = [
    ("dom", "p_plan", 0),
    ("dom", "p_neg", 0),
    ("dom", "p_disj", 0),
    ("dom", "p_exists", 0),
    ("dom", "p_goaltrue", 0),
    ("dom", "p_goalfalse_unreach", 11),
    ("dom", "p_unsolv_search", 11),
    // Its objects have names that no planner reads as they are.
    ("names_dom", "names_p3", 0),
];

/// One trial per planner; that of a program which is not installed is ignored.
pub(crate) fn trials() -> Vec<Trial> {
    ["ff", "fast-downward"]
        .into_iter()
        .flat_map(|name| {
            let title = |what: &str| format!("planner::{}_{what}", name.replace('-', "_"));
            let trials = [
                Trial::test(title("gives_every_outcome"), move || outcomes(name)),
                Trial::test(title("stacks_blocks_from_the_command_line"), move || command_line(name)),
            ];
            trials.map(|trial| trial.with_ignored_flag(!is_installed(name)))
        })
        .collect()
}

/// The whole way: memory, template, program, simulation, plan.
fn command_line(planner: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let memory = format!("file:{}", folder.path().join("robot.rmem").display());
    let words = [
        ["--load", "fixtures/blocksworld.json"],
        ["--domain", "domains/blocksworld/domain.pddl"],
        ["--template", "templates/blocksworld/problem.pddl.j2"],
        ["--goal", "(on A B)"],
        ["--planner", planner],
        ["--memory", &memory],
    ];
    let output = Command::new(env!("CARGO_BIN_EXE_rmem"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .arg("plan")
        .args(words.iter().flatten())
        .output()?;
    let (plan, said) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    // The blocks are called as in the memory, and the last step reaches the goal.
    let last = plan.lines().rfind(|line| line.starts_with('('));
    match (output.status.code(), last) {
        (Some(0), Some(last)) if last.to_lowercase().contains("stack") && last.ends_with(" A B)") => Ok(()),
        (code, _) => Err(format!("{code:?}:\n{plan}{said}").into()),
    }
}

fn is_installed(program: &str) -> bool {
    std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join(program).is_file()))
}

fn outcomes(planner: &str) -> Result<(), Failed> {
    for (domain, problem, code) in OUTCOMES {
        let run = plan(planner, domain, problem)?;
        if Exit::from(&run.outcome).code() != code {
            return Err(format!(
                "{domain} {problem}: {:?} and not {code}: {}\n{}",
                run.outcome,
                run.message,
                run.tail()
            )
            .into());
        }
    }
    let run = plan(planner, "names_dom", "names_p3")?;
    let steps = &run.outcome.plan().ok_or("no plan")?.steps;
    if steps.iter().map(|step| &step.arguments).ne([&["b.c".to_owned()]]) {
        return Err(format!("the names are not the problem's: {steps:?}").into());
    }
    Ok(())
}

fn plan(planner: &str, domain: &str, problem: &str) -> Result<Run, Failed> {
    let read = |name: &str| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/transcripts/tasks");
        fs::read_to_string(folder.join(format!("{name}.pddl"))).map(|text| Source::new(name.to_owned(), text))
    };
    let domain = Domain::read(&read(domain)?, Dialect::default()).map_err(|wrong| format!("{wrong:?}"))?;
    let problem = Problem::read(&read(problem)?, &domain, Dialect::default()).map_err(|wrong| format!("{wrong:?}"))?;
    let task = Task { domain: &domain, problem: &problem };
    let interrupted = AtomicBool::new(false);
    let temporary = tempfile::tempdir()?;
    let host = Host {
        exe: env!("CARGO_BIN_EXE_rmem").into(),
        temporary: temporary.path().to_owned(),
        interrupted: &interrupted,
    };
    let limits = Limits { time: Some(Duration::from_secs(30)), ..Limits::default() };
    let planner = by_name(planner, false).ok_or("no such planner")?;
    let run = run(planner.as_ref(), &task, &limits, &host);
    match fs::read_dir(temporary.path())?.count() {
        0 => Ok(run),
        left => Err(format!("{left} directories are left").into()),
    }
}
