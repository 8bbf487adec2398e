//! `rmem compare PATH… --planner A --planner B`: planners side by side.

mod plot;
mod rows;
mod task;

use std::path::{Path, PathBuf};
use std::time::Duration;

use bson::{DateTime, doc};
use clap::Args;

use self::rows::Rows;
use self::task::{Named, TaskLocation};
use super::{Context, UsageError, formats};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::fault::{AtFault, Fault};
use crate::formats::quantity;
use crate::interrupt::InterruptGuard;
use crate::memory::Memory;
use crate::output::Format;
use crate::planner::{Host, Limits, Planner, Task};
use crate::planning::MAX_OUTPUT;
use crate::planning::comparison::{Measurement, Score, Setup, measure, program_files, refute, scores, unscored};
use crate::store::{Find, Namespace};
use crate::views::pictures;

/// The formats: lines appear as they are measured.
const FORMATS: [Format; 5] = [Format::Jsonl, Format::Json, Format::Table, Format::Csv, Format::Tsv];
/// The limit of memory where none is given: none, but that the memory in use is looked at.
const NO_LIMIT: u64 = i64::MAX as u64;

/// What stands below the help of `compare`.
const HELP: &str = "\
Examples:
  rmem compare domain.pddl p01.pddl p02.pddl --planner builtin --planner ff
  rmem compare benchmarks/ --planner builtin --planner fast-downward --timeout 30s --format csv
  rmem compare --stored robmem.plans --planner ff --plot solved.svg

Runs each planner on each task, one after the other, and validates each plan by simulation. A folder has domain.pddl \
and problems (or a folder `instances` of them), or folders of such; behind a domain, it may have problems alone. --stored takes the tasks of stored plans, instantiated \
from the memory as it is now.

Prints a document for each run (seconds are wall time, memory is the most that was seen resident, in bytes; cost is the \
metric's value, else the makespan or the number of steps), and for each planner its coverage, the satisficing and agile \
scores of the IPC, and PAR10. With csv and tsv, the scores are printed by --scores. The satisficing score compares with \
the best plan that one of the planners found. That a task has no plan counts as solved, unless another planner has a \
plan: then it is `wrong`. Tasks that cannot be read are `unreadable`, count as not solved, and make the exit code 3.

Runs are kept in the memory. The same command goes on where it was interrupted, and prints what is there; a run is made \
again where the task, the planner's program or arguments, or the limits have changed. --again runs everything again.";

/// Run planners side by side: coverage, times, costs, scores
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&FORMATS))]
pub struct CompareArgs {
    /// Folders of tasks; or a domain and its problems
    #[arg(value_name = "PATH", required_unless_present = "stored")]
    pub paths: Vec<PathBuf>,
    /// Planner: builtin, ff, fast-downward, or a [planner.NAME] of rmem.toml (can be repeated)
    #[arg(long, value_name = "NAME", default_value = "builtin")]
    pub planner: Vec<String>,
    /// Compare on the tasks of the plans stored in NS
    #[arg(long, value_name = "NS", conflicts_with = "paths")]
    pub stored: Option<Namespace>,
    /// Take only tasks whose name contains TEXT
    #[arg(long, value_name = "TEXT", default_value = "", hide_default_value = true)]
    pub only: String,
    /// Time limit of a run
    #[arg(long, value_name = "DURATION", default_value = "60s", value_parser = quantity::time_limit)]
    pub timeout: Duration,
    /// Memory limit of a run
    #[arg(long, value_name = "SIZE", value_parser = quantity::memory_limit)]
    pub memory_limit: Option<u64>,
    /// Let planners use all of the time to find better plans
    #[arg(long)]
    pub anytime: bool,
    /// Run each planner N times on a task, and take the run of median time
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u16).range(1..))]
    pub repeat: u16,
    /// Collection in which the runs are kept
    #[arg(long, value_name = "NS", default_value = "robmem.comparisons")]
    pub into: Namespace,
    /// Keep the runs nowhere
    #[arg(long)]
    pub no_store: bool,
    /// Run everything again
    #[arg(long)]
    pub again: bool,
    /// Print the scores only
    #[arg(long)]
    pub scores: bool,
    /// Draw how many tasks were solved within which time, to FILE, .svg or .png
    #[arg(long, value_name = "FILE", value_parser = super::plot::picture_file)]
    pub plot: Option<PathBuf>,
}

pub(super) fn run(args: &CompareArgs, context: &mut Context<'_>) -> Result<Exit> {
    if args.plot.is_some() {
        pictures::ready()?;
    }
    let planners = planners(args, context)?;
    let memory = context.memory_to_fill()?;
    let place = args.stored.as_ref().map_or(TaskLocation::Paths(&args.paths), TaskLocation::Plans);
    let found = task::find(&place, &args.only, &memory)?;
    if found.repeated > 0 {
        context.output.note(&format!("{} of the tasks are named twice; each is run once", found.repeated));
    }
    let format = context.format(&FORMATS)?;
    let guard = InterruptGuard::new();
    let host = Host { interrupted: guard.interrupted(), ..context.host() };
    let programs = planners.iter().map(|planner| program(planner.as_ref(), &host, context)).collect::<Result<_>>()?;
    let mut comparison = Comparison {
        args,
        memory,
        planners,
        programs,
        host,
        rows: Rows::new(format, args.scores),
        measured: Vec::new(),
        known: 0,
        unreadable: 0,
    };
    let is_whole = comparison.measure_all(&found.tasks, context)?;
    comparison.report(found.tasks.len(), is_whole, context)?;
    if !is_whole {
        context.output.warn(match (args.no_store, args.again) {
            (true, _) => "interrupted; with --no-store, no run is kept",
            (_, true) => "interrupted; the same command without --again goes on from here",
            _ => "interrupted; the same command goes on from here",
        });
        return Ok(Exit::Interrupted);
    }
    Ok(if comparison.unreadable > 0 { Exit::BadInput } else { Exit::Done })
}

/// The planners, each once.
fn planners(args: &CompareArgs, context: &Context<'_>) -> Result<Vec<Box<dyn Planner>>> {
    let registry = context.planners();
    let mut names: Vec<&str> = Vec::new();
    for name in &args.planner {
        if names.contains(&name.as_str()) {
            return Err(UsageError::new(format!("the planner `{name}` is named twice")).into());
        }
        names.push(name);
    }
    let planners: Vec<Box<dyn Planner>> =
        names.iter().map(|name| registry.get(name, args.anytime)).collect::<Result<_, _>>()?;
    if args.anytime && !planners.iter().any(|planner| planner.is_anytime()) {
        let message = format!("{} cannot improve a plan; leave out --anytime", names.join(", "));
        return Err(UsageError::new(message).into());
    }
    Ok(planners)
}

/// A planner that is not installed, which is known before the first run.
#[derive(Debug, thiserror::Error)]
#[error("{planner}: the planner's program was not found: {install}")]
struct NotInstalled {
    planner: String,
    install: String,
}

impl AtFault for NotInstalled {
    fn fault(&self) -> Fault {
        Fault::Program
    }
}

/// The files of a planner's command.
fn program(planner: &dyn Planner, host: &Host<'_>, context: &Context<'_>) -> Result<Vec<String>> {
    let command = planner.command(host);
    let name = command.first().and_then(|word| word.to_str()).unwrap_or_default();
    let found = context.program(name);
    // A file that cannot be executed is an outcome, with the reason.
    if found.is_none() && !Path::new(name).exists() {
        return Err(NotInstalled { planner: planner.name().to_owned(), install: planner.install() }.into());
    }
    Ok(program_files(found, &command))
}

/// A comparison as it goes on.
struct Comparison<'a> {
    args: &'a CompareArgs,
    memory: Memory,
    planners: Vec<Box<dyn Planner>>,
    /// The files of each planner's command.
    programs: Vec<Vec<String>>,
    host: Host<'a>,
    rows: Rows,
    measured: Vec<Measurement>,
    /// How many runs were there already.
    known: usize,
    /// How many tasks cannot be read.
    unreadable: usize,
}

impl Comparison<'_> {
    /// Measures every planner on every task; returns false where it was interrupted.
    fn measure_all(&mut self, tasks: &[Named], context: &mut Context<'_>) -> Result<bool> {
        let progress = context.output.progress("reading the tasks");
        for (place, named) in tasks.iter().enumerate() {
            let start = self.measured.len();
            let is_whole = match named.read(&self.memory, context)? {
                Ok((domain, problem)) => {
                    let say = |planner: &str| {
                        let (place, count) = (place + 1, tasks.len());
                        progress.say(&format!("task {place} of {count}: {planner} on {}", named.name));
                    };
                    self.measure_task(&named.name, &Task { domain: &domain, problem: &problem }, &say, context)?
                }
                Err(error) => {
                    self.leave_out(&named.name, &error, context);
                    true
                }
            };
            self.settle(start, context)?;
            self.rows.print(&self.measured, true, context)?;
            if !is_whole {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Measures every planner on a task; returns false where it was interrupted.
    fn measure_task(
        &mut self,
        name: &str,
        task: &Task<'_>,
        say: &dyn Fn(&str),
        context: &mut Context<'_>,
    ) -> Result<bool> {
        for nth in 0..self.planners.len() {
            say(self.planners.get(nth).map(|planner| planner.name()).unwrap_or_default());
            let Some(measured) = self.measured_one(nth, name, task)? else { return Ok(false) };
            let took = Duration::try_from_secs_f64(measured.seconds).unwrap_or_default();
            context.output.operation("compare", &format!("{} on {name}", measured.planner), &measured.outcome, took);
            self.measured.push(measured);
            self.rows.print(&self.measured, false, context)?;
        }
        Ok(true)
    }

    /// Counts a task that cannot be read for every planner, as one that is not solved.
    fn leave_out(&mut self, name: &str, error: &Error, context: &mut Context<'_>) {
        context.output.warn(&format!("{name} cannot be read: {error}"));
        self.unreadable += 1;
        let (timeout, message) = (self.args.timeout, error.to_string());
        let names = self.planners.iter().map(|planner| planner.name());
        self.measured.extend(names.map(|planner| Measurement::unreadable(name, planner, timeout, &message)));
    }

    /// Looks, once all planners ran on a task, who said wrongly that it has no plan.
    fn settle(&mut self, start: usize, context: &mut Context<'_>) -> Result<()> {
        let Some(rows) = self.measured.get_mut(start..) else { return Ok(()) };
        for place in refute(rows) {
            let Some(wrong) = rows.get(place) else { continue };
            context.output.warn(&format!("{} on {}: {}", wrong.planner, wrong.task, wrong.message));
            if !self.args.no_store {
                self.memory.put(&self.args.into, vec![wrong.to_document(DateTime::now())])?;
            }
        }
        Ok(())
    }

    /// A run, or the one that is kept; none where it was interrupted.
    fn measured_one(&mut self, nth: usize, name: &str, task: &Task<'_>) -> Result<Option<Measurement>> {
        let (Some(planner), Some(program)) = (self.planners.get(nth), self.programs.get(nth)) else { return Ok(None) };
        let memory = Some(self.args.memory_limit.unwrap_or(NO_LIMIT));
        let limits = Limits { time: Some(self.args.timeout), memory, output: MAX_OUTPUT };
        let task = Task { domain: task.domain, problem: task.problem };
        let anytime = self.args.anytime;
        let repeats = usize::from(self.args.repeat);
        let setup = Setup { name, planner: planner.as_ref(), task, limits, anytime, repeats, program };
        if let Some(kept) = self.kept(&setup.key(&self.host))? {
            self.known += 1;
            return Ok(Some(Measurement { task: name.to_owned(), ..kept }));
        }
        if self.host.is_interrupted() {
            return Ok(None);
        }
        let measured = measure(&setup, &self.host);
        if self.host.is_interrupted() {
            return Ok(None);
        }
        if measured.is_final() && !self.args.no_store {
            self.memory.put(&self.args.into, vec![measured.to_document(DateTime::now())])?;
        }
        Ok(Some(measured))
    }

    /// The run that is kept under a key.
    fn kept(&self, key: &str) -> Result<Option<Measurement>> {
        if self.args.again || self.args.no_store {
            return Ok(None);
        }
        let find = Find { filter: doc! { "_id": key }, limit: 1, ..Find::default() };
        let found = self.memory.find(&self.args.into, &find)?.next().transpose()?;
        let found = found.map(super::query::owned).transpose()?;
        Ok(found.as_ref().and_then(Measurement::from_document))
    }

    /// Prints what is not printed yet: runs, scores, the plot.
    fn report(&self, tasks: usize, is_whole: bool, context: &mut Context<'_>) -> Result<()> {
        if self.known > 0 {
            let all = tasks * self.planners.len();
            context.output.note(&format!("{} of {all} runs were there already; --again runs them again", self.known));
        }
        // Scores compare planners on the same tasks.
        let compared = on_whole_tasks(&self.measured, self.planners.len());
        if !is_whole {
            let count = compared.len() / self.planners.len().max(1);
            context.output.note(&format!("the scores are of the {count} of {tasks} tasks on which all planners ran"));
        }
        for task in unscored(compared) {
            let why = "a plan's cost is negative or not known";
            context.output.note(&format!("{task} counts for no satisficing score: {why}"));
        }
        if let Some(path) = &self.args.plot {
            super::plot::write(path, &plot::solved(compared, self.args.timeout).draw()?, context)?;
        }
        let scores = scores(compared).iter().map(Score::listed).collect();
        self.rows.end(&self.measured, scores, context)
    }
}

/// The runs of the tasks on which all planners ran; of the last one, some may be missing.
fn on_whole_tasks(measured: &[Measurement], planners: usize) -> &[Measurement] {
    let rest = measured.len().checked_rem(planners).unwrap_or_default();
    measured.get(..measured.len() - rest).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_that_was_interrupted_counts_for_no_score() {
        let run = |task: &str, planner: &str| Measurement::unreadable(task, planner, Duration::from_secs(1), "");
        let measured = [run("a", "x"), run("a", "y"), run("b", "x")];
        let tasks = |count: usize, planners| on_whole_tasks(&measured[..count], planners).len();
        assert_eq!((tasks(3, 2), tasks(2, 2), tasks(1, 2), tasks(3, 1), tasks(0, 2)), (2, 2, 0, 3, 0));
    }
}
