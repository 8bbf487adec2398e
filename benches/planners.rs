//! Each task of a folder with each planner, and what rmem adds to each.
//!
//! `cargo bench --bench planners -- FOLDER [--timeout 30] [--planner NAME]… [--only WORD] [--pairs 3]`
//!
//! `FOLDER` has one folder per task with `domain.pddl` and `problem.pddl`; without one, the small tasks of
//! the fixtures are taken. Planners that are not installed are left out. A task that a planner
//! solves in less than two seconds is run again, `rmem plan` and the planner alone in turn, and rmem's own
//! share is the median of the differences.

#![allow(clippy::print_stdout)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Tasks that take longer are run once.
const QUICK: Duration = Duration::from_secs(2);

struct Settings {
    tasks: PathBuf,
    timeout: u64,
    planners: Vec<String>,
    only: String,
    pairs: usize,
}

impl Settings {
    fn read() -> Self {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/tasks");
        let mut settings = Self { tasks: fixtures, timeout: 30, planners: Vec::new(), only: String::new(), pairs: 3 };
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            let mut value = || words.next().unwrap_or_else(|| panic!("expected a value after {word}"));
            match word.as_str() {
                // What cargo itself says to every benchmark.
                "--bench" => {}
                "--timeout" => settings.timeout = value().parse().expect("seconds"),
                "--pairs" => settings.pairs = value().parse().expect("a number"),
                "--planner" => settings.planners.push(value()),
                "--only" => settings.only = value(),
                folder => settings.tasks = folder.into(),
            }
        }
        if settings.planners.is_empty() {
            let known = ["builtin", "ff", "fast-downward"].into_iter().filter(|name| is_installed(name));
            settings.planners = known.map(str::to_owned).collect();
        }
        settings
    }

    fn tasks(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.tasks).unwrap_or_else(|error| panic!("{}: {error}", self.tasks.display()));
        let mut tasks: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        tasks.retain(|task| task.join("problem.pddl").is_file() && name(task).contains(&self.only));
        tasks.sort();
        tasks
    }
}

fn name(task: &Path) -> String {
    task.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn is_installed(planner: &str) -> bool {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    planner == "builtin" || std::env::split_paths(&folders).any(|folder| folder.join(planner).is_file())
}

/// What a command did.
struct Run {
    wall: Duration,
    cpu: Duration,
    code: Option<i32>,
    stdout: String,
}

fn run(mut command: Command) -> Run {
    command.stdin(Stdio::null()).stderr(Stdio::null());
    let (before, start) = (spent(), Instant::now());
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let (wall, cpu) = (start.elapsed(), spent().saturating_sub(before));
    Run { wall, cpu, code: output.status.code(), stdout: String::from_utf8_lossy(&output.stdout).into_owned() }
}

/// The processor time of all children so far, in hundredths of a second.
fn spent() -> Duration {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit_once(") ").map_or("", |(_, fields)| fields).split(' ').skip(13).take(2);
    Duration::from_millis(fields.filter_map(|field| field.parse::<u64>().ok()).sum::<u64>() * 10)
}

fn rmem(task: &Path, planner: &str, settings: &Settings) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
    command.args(["--memory", "mem:", "-q", "plan", "--format", "text", "--planner", planner, "--timeout"]);
    command.arg(format!("{}s", settings.timeout));
    command.arg("-d").arg(task.join("domain.pddl")).arg("-p").arg(task.join("problem.pddl"));
    command
}

/// The planner without rmem around it; none where that cannot be said.
fn alone(task: &Path, planner: &str, folder: &Path) -> Option<Command> {
    let (domain, problem) = (task.join("domain.pddl"), task.join("problem.pddl"));
    let mut command = match planner {
        "builtin" => Command::new(env!("CARGO_BIN_EXE_rmem")),
        "ff" | "fast-downward" => Command::new(planner),
        _ => return None,
    };
    match planner {
        "builtin" => command.args(["ff", "--checked", "-o"]).arg(domain).arg("-f").arg(problem),
        "ff" => command.arg("-o").arg(domain).arg("-f").arg(problem),
        _ => command.args(["--alias", "lama-first", "--plan-file", "plan"]).arg(domain).arg(problem),
    };
    command.current_dir(folder);
    Some(command)
}

/// What rmem adds to a planner on a task, and what the planner takes alone: medians of pairs.
fn share(task: &Path, planner: &str, settings: &Settings) -> Option<(f64, f64)> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut pairs: Vec<(f64, f64)> = Vec::new();
    for _ in 0..settings.pairs {
        let alone = run(alone(task, planner, folder.path())?).wall.as_secs_f64();
        let whole = run(rmem(task, planner, settings)).wall.as_secs_f64();
        pairs.push((whole - alone, alone));
    }
    let mut median = |key: fn(&(f64, f64)) -> f64| {
        pairs.sort_by(|one, other| key(one).total_cmp(&key(other)));
        pairs.get(pairs.len() / 2).map(key)
    };
    Some((median(|pair| pair.0)?, median(|pair| pair.1)?))
}

fn main() {
    let settings = Settings::read();
    println!("| task | planner | outcome | wall s | cpu s | steps | alone s | rmem's share |");
    println!("|---|---|---|--:|--:|--:|--:|--:|");
    let mut solved: Vec<(String, usize)> = settings.planners.iter().map(|name| (name.clone(), 0)).collect();
    for task in settings.tasks() {
        for (planner, solved) in &mut solved {
            let whole = run(rmem(&task, planner, &settings));
            let steps = whole.stdout.lines().filter(|line| line.contains('(') && !line.starts_with(';')).count();
            let is_solved = whole.code == Some(0);
            *solved += usize::from(is_solved);
            let outcome = whole.code.map_or_else(|| "a signal".to_owned(), |code| code.to_string());
            let share = (is_solved && whole.wall < QUICK).then(|| share(&task, planner, &settings)).flatten();
            let (alone, share) = share.map_or_else(Default::default, |(share, alone)| {
                (format!("{alone:.3}"), format!("{:.1} ms, {:.0} %", share * 1e3, share / alone * 1e2))
            });
            let steps = if is_solved { steps.to_string() } else { String::new() };
            let (wall, cpu) = (whole.wall.as_secs_f64(), whole.cpu.as_secs_f64());
            let task = name(&task);
            println!("| {task} | {planner} | {outcome} | {wall:.2} | {cpu:.2} | {steps} | {alone} | {share} |");
        }
    }
    for (planner, solved) in solved {
        println!("\n{planner}: {solved} solved");
    }
}
