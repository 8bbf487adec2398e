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
use rmem::planner::{Host, Limits, Registry, Run, Task, run};

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
                Trial::test(title("serves_an_executive_whose_world_changes"), move || executive(name)),
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
    let (plan, printed) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    // The blocks are called as in the memory, and the last step reaches the goal.
    let last = plan.lines().rfind(|line| line.starts_with('('));
    match (output.status.code(), last) {
        (Some(0), Some(last)) if last.to_lowercase().contains("stack") && last.ends_with(" A B)") => Ok(()),
        (code, _) => Err(format!("{code:?}:\n{plan}{printed}").into()),
    }
}

/// The example of an executive; in the middle of its plan, a block is taken off the tower.
fn executive(planner: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let memory = format!("file:{}", folder.path().join("robot.rmem").display());
    let hands = folder.path().join("hands.sh");
    let disturbance = "rmem delete robmem.worldmodel \"{object_top: 'B'}\" >&2\n\
                       rmem insert -q robmem.worldmodel \"{relation: 'on-table', object: 'B'}\" \
                       \"{relation: 'clear', object: 'C'}\" >&2";
    let count = folder.path().join("count");
    let count = count.display();
    let text = format!(
        "#!/bin/sh\nset -eu\necho x >>{count}\nif [ \"$(wc -l <{count})\" -eq 3 ]; then\n{disturbance}\nfi\n\
         exec examples/shell/blocks.sh \"$@\"\n"
    );
    fs::write(&hands, text)?;
    let programs = Path::new(env!("CARGO_BIN_EXE_rmem")).parent().ok_or("no folder")?.display().to_string();
    let path = format!("{programs}:{}", std::env::var("PATH").unwrap_or_default());
    let line = "chmod +x \"$1\" && rmem count robmem.worldmodel --load fixtures/blocksworld.json >/dev/null && \
                sh examples/shell/executive.sh domains/blocksworld/domain.pddl \
                templates/blocksworld/problem.pddl.j2 '(and (on A B) (on B C))' \"$1\" --planner \"$2\" && \
                rmem count robmem.worldmodel \"{object_top: 'B', object_bottom: 'C'}\"";
    let output = Command::new("sh")
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["-c", line, "sh"])
        .arg(&hands)
        .arg(planner)
        .env("RMEM_MEMORY", &memory)
        .env("PATH", path)
        .env("TMPDIR", folder.path())
        .output()?;
    let (reported, printed) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let lines: Vec<&str> = reported.lines().collect();
    match output.status.code() {
        Some(0) if lines.contains(&"plan 2") && lines.ends_with(&["did stack A B", "1"]) => Ok(()),
        code => Err(format!("{code:?}:\n{reported}{printed}").into()),
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
        listener: Default::default(),
    };
    let limits = Limits { time: Some(Duration::from_secs(30)), ..Limits::default() };
    let planner = Registry::default().get(planner, false)?;
    let run = run(planner.as_ref(), &task, &limits, &host);
    match fs::read_dir(temporary.path())?.count() {
        0 => Ok(run),
        left => Err(format!("{left} directories are left").into()),
    }
}
