//! Each task of a folder with each planner, and what rmem adds to each.
//!
//! `cargo bench --bench planners -- FOLDER [--timeout 30] [--planner NAME]… [--only WORD] [--pairs 3] [--every N]
//! [--odd | --even]`
//!
//! `FOLDER` has one folder per task with `domain.pddl` and `problem.pddl`, or one per domain with several problems, as the
//! collections of the competitions have; without one, the small tasks of the fixtures are taken. Of the problems of a
//! domain, `--odd` and `--even` take every other one, and `--every` only each Nth of those. A second table says by domain how
//! many each planner solved, and how the first one compares with each other on the tasks that both solve: medians of the
//! quotients of processor times and of plan costs. Planners that are not installed are left out. A task that a planner
//! solves in less than two seconds is run again, `rmem plan` and the planner alone in turn, and rmem's own
//! share is the median of the differences.

#![allow(clippy::print_stdout)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rmem::planning::comparison::{TaskFiles as Task, tasks};

/// Tasks that take longer are run once.
const QUICK: Duration = Duration::from_secs(2);

struct Settings {
    tasks: PathBuf,
    timeout: u64,
    planners: Vec<String>,
    only: String,
    pairs: usize,
    every: usize,
    parity: Option<usize>,
}

impl Settings {
    fn read() -> Self {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/tasks");
        let mut settings = Self {
            tasks: fixtures,
            timeout: 30,
            planners: Vec::new(),
            only: String::new(),
            pairs: 3,
            every: 1,
            parity: None,
        };
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
                "--every" => settings.every = value().parse().expect("a number"),
                "--odd" => settings.parity = Some(0),
                "--even" => settings.parity = Some(1),
                folder => settings.tasks = folder.into(),
            }
        }
        if settings.planners.is_empty() {
            let known = ["builtin", "ff", "fast-downward"].into_iter().filter(|name| is_installed(name));
            settings.planners = known.map(str::to_owned).collect();
        }
        settings
    }

    fn tasks(&self) -> Vec<Task> {
        let all = tasks(&self.tasks).unwrap_or_else(|error| panic!("{}: {error}", self.tasks.display()));
        let groups = all.chunk_by(|one, other| one.group == other.group);
        let mut tasks: Vec<Task> = groups.flat_map(|group| self.of_domain(group)).collect();
        tasks.retain(|task| task.name.contains(&self.only) || task.group.contains(&self.only));
        tasks
    }

    /// Those of the tasks of a domain that are asked for.
    fn of_domain(&self, group: &[Task]) -> Vec<Task> {
        let chosen = group.iter().enumerate().filter(|(place, _)| self.parity.is_none_or(|parity| place % 2 == parity));
        chosen.map(|(_, task)| task.clone()).step_by(self.every.max(1)).collect()
    }
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

fn rmem(task: &Task, planner: &str, settings: &Settings) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
    command.args(["--memory", "mem:", "-q", "plan", "--format", "text", "--planner", planner, "--timeout"]);
    command.arg(format!("{}s", settings.timeout));
    command.arg("-d").arg(&task.domain).arg("-p").arg(&task.problem);
    command
}

/// The planner without rmem around it; none where that is not possible.
fn alone(task: &Task, planner: &str, folder: &Path) -> Option<Command> {
    let (domain, problem) = (&task.domain, &task.problem);
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
fn share(task: &Task, planner: &str, settings: &Settings) -> Option<(f64, f64)> {
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
    let mut results: Vec<(String, Vec<Option<Solved>>)> = Vec::new();
    for task in settings.tasks() {
        let mut row = Vec::new();
        for planner in &settings.planners {
            let whole = run(rmem(&task, planner, &settings));
            let steps = whole.stdout.lines().filter(|line| line.contains('(') && !line.starts_with(';')).count();
            let is_solved = whole.code == Some(0);
            row.push(is_solved.then(|| Solved { cpu: whole.cpu, cost: cost(&whole.stdout).unwrap_or(steps as f64) }));
            let outcome = whole.code.map_or_else(|| "a signal".to_owned(), |code| code.to_string());
            let share = (is_solved && whole.wall < QUICK).then(|| share(&task, planner, &settings)).flatten();
            let (alone, share) = share.map_or_else(Default::default, |(share, alone)| {
                (format!("{alone:.3}"), format!("{:.1} ms, {:.0} %", share * 1e3, share / alone * 1e2))
            });
            let steps = if is_solved { steps.to_string() } else { String::new() };
            let (wall, cpu) = (whole.wall.as_secs_f64(), whole.cpu.as_secs_f64());
            let task = &task.name;
            println!("| {task} | {planner} | {outcome} | {wall:.2} | {cpu:.2} | {steps} | {alone} | {share} |");
        }
        results.push((task.group, row));
    }
    summary(&settings.planners, &results);
}

/// What a planner needed for a task that it solved.
#[derive(Clone, Copy)]
struct Solved {
    cpu: Duration,
    cost: f64,
}

/// The cost that rmem prints with a plan.
fn cost(text: &str) -> Option<f64> {
    let line = text.lines().find(|line| line.starts_with("; cost"))?;
    line.split(|sign: char| !sign.is_ascii_digit() && sign != '.').find_map(|word| word.parse().ok())
}

/// A row for each domain, and one for all.
fn summary(planners: &[String], results: &[(String, Vec<Option<Solved>>)]) {
    println!("\n| domain | tasks | {} | time | cost |", planners.join(" | "));
    println!("|---|--:|{}--:|--:|", "--:|".repeat(planners.len()));
    let mut groups: Vec<&str> = results.iter().map(|(group, _)| group.as_str()).collect();
    groups.dedup();
    for group in groups.into_iter().map(Some).chain([None]) {
        let rows: Vec<&[Option<Solved>]> = results
            .iter()
            .filter(|(name, _)| group.is_none_or(|group| group == name))
            .map(|(_, row)| row.as_slice())
            .collect();
        let solved =
            (0..planners.len()).map(|place| rows.iter().filter(|row| row[place].is_some()).count().to_string());
        let solved = solved.collect::<Vec<_>>().join(" | ");
        let quotients = |of: fn(&Solved) -> f64| -> String {
            let compared = (1..planners.len()).map(|place| {
                let both = rows.iter().filter_map(|row| Some(of(&row[0]?) / of(&row[place]?)));
                median(both.filter(|quotient| quotient.is_finite()).collect())
            });
            compared.collect::<Vec<_>>().join(", ")
        };
        let (times, costs) = (quotients(|solved| solved.cpu.as_secs_f64()), quotients(|solved| solved.cost));
        println!("| {} | {} | {solved} | {times} | {costs} |", group.unwrap_or("all"), rows.len());
    }
}

fn median(mut numbers: Vec<f64>) -> String {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).map_or_else(|| "-".to_owned(), |median| format!("{median:.2}"))
}
