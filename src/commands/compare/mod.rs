//! `rmem compare PATH… --planner A --planner B`: planners side by side.

mod plot;
mod task;

use std::path::PathBuf;
use std::time::Duration;

use bson::{Bson, DateTime, Document, doc};
use clap::Args;

use self::task::{Named, Place};
use super::{Context, UsageError, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{quantity, shell};
use crate::interrupt::InterruptGuard;
use crate::memory::Memory;
use crate::output::Format;
use crate::planner::{Host, Limits, Planner, Task};
use crate::planning::comparison::{Measurement, Score, Setup, measure, scores};
use crate::store::{Find, Namespace};
use crate::views::pictures;

/// The formats: lines appear as they are measured.
const FORMATS: [Format; 5] = [Format::Jsonl, Format::Json, Format::Table, Format::Csv, Format::Tsv];
/// The most that a planner may print, in bytes.
const MAX_OUTPUT: u64 = 16 << 20;
/// The limit of memory where none is given: none, but that the memory in use is looked at.
const NO_LIMIT: u64 = i64::MAX as u64;

/// What stands below the help of `compare`.
const HELP: &str = "\
Examples:
  rmem compare domain.pddl p01.pddl p02.pddl --planner builtin --planner ff
  rmem compare benchmarks/ --planner builtin --planner fast-downward --timeout 30s --format csv
  rmem compare --stored robmem.plans --planner ff --plot solved.svg

Runs each planner on each task, one after the other, and validates each plan by simulation. A folder has domain.pddl \
and problems, or folders of such; --stored takes the tasks of stored plans, instantiated from the memory as it is now.

Prints a document for each run (seconds are wall time, memory is the most that was seen resident, in bytes), and for \
each planner its coverage, the satisficing and agile scores of the IPC, and PAR10. With csv and tsv, the scores are \
printed by --scores. The satisficing score compares with the best plan that one of the planners found.

Runs are kept in the memory. The same command goes on where it was interrupted, and prints what is there; --again \
runs everything again.";

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
    #[arg(long, value_name = "DURATION", default_value = "60s", value_parser = quantity::duration)]
    pub timeout: Duration,
    /// Memory limit of a run
    #[arg(long, value_name = "SIZE", value_parser = quantity::size)]
    pub memory_limit: Option<u64>,
    /// Let planners use all of the time to find better plans
    #[arg(long)]
    pub anytime: bool,
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
    let place = args.stored.as_ref().map_or(Place::Paths(&args.paths), Place::Plans);
    let tasks = task::find(&place, &args.only, &memory)?;
    let format = context.format(&FORMATS)?;
    let guard = InterruptGuard::new();
    let host = Host { interrupted: guard.interrupted(), ..context.host() };
    let mut comparison = Comparison { args, memory, planners, host, format, measured: Vec::new(), known: 0 };
    let is_whole = comparison.measure_all(&tasks, context)?;
    comparison.report(context)?;
    if is_whole {
        return Ok(Exit::Done);
    }
    context.output.warn("interrupted; the same command goes on from here");
    Ok(Exit::Interrupted)
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
    names.into_iter().map(|name| Ok(registry.get(name, args.anytime)?)).collect()
}

/// A comparison as it goes on.
struct Comparison<'a> {
    args: &'a CompareArgs,
    memory: Memory,
    planners: Vec<Box<dyn Planner>>,
    host: Host<'a>,
    format: Format,
    measured: Vec<Measurement>,
    /// How many runs were there already.
    known: usize,
}

impl Comparison<'_> {
    /// Measures every planner on every task; returns false where it was interrupted.
    fn measure_all(&mut self, tasks: &[Named], context: &mut Context<'_>) -> Result<bool> {
        let progress = context.output.progress("reading the tasks");
        let (mut place, mut count) = (0, tasks.len());
        for named in tasks {
            let Some((domain, problem)) = named.read(&self.memory, context)? else {
                count -= 1;
                continue;
            };
            place += 1;
            let task = Task { domain: &domain, problem: &problem };
            for nth in 0..self.planners.len() {
                let planner = self.planners.get(nth).map(|planner| planner.name()).unwrap_or_default();
                progress.say(&format!("task {place} of {count}: {planner} on {}", named.name));
                let Some(measured) = self.measured_one(nth, &named.name, &task)? else { return Ok(false) };
                self.print(&measured, context)?;
                self.measured.push(measured);
            }
        }
        Ok(true)
    }

    /// A run, or the one that is kept; none where it was interrupted.
    fn measured_one(&mut self, nth: usize, name: &str, task: &Task<'_>) -> Result<Option<Measurement>> {
        let Some(planner) = self.planners.get(nth) else { return Ok(None) };
        let memory = Some(self.args.memory_limit.unwrap_or(NO_LIMIT));
        let limits = Limits { time: Some(self.args.timeout), memory, output: MAX_OUTPUT };
        let task = Task { domain: task.domain, problem: task.problem };
        let setup = Setup { name, planner: planner.as_ref(), task, limits };
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

    /// Prints a run at once, where its format is one of lines.
    fn print(&self, measured: &Measurement, context: &mut Context<'_>) -> Result<()> {
        if self.format != Format::Jsonl || self.args.scores {
            return Ok(());
        }
        context.output.line(&shell::relaxed(&measured.listed()))?;
        Ok(context.output.flush()?)
    }

    /// Prints what is not printed yet: runs, scores, the plot.
    fn report(&self, context: &mut Context<'_>) -> Result<()> {
        if self.known > 0 {
            let all = self.measured.len();
            context.output.note(&format!("{} of {all} runs were there already; --again runs them again", self.known));
        }
        let scores: Vec<Document> = scores(&self.measured).iter().map(Score::listed).collect();
        let runs: Vec<Document> = self.measured.iter().map(Measurement::listed).collect();
        if let Some(path) = &self.args.plot {
            super::plot::write(path, &plot::solved(&self.measured).positive().draw()?, context)?;
        }
        let printed: Vec<Document> = match (self.format, self.args.scores) {
            (Format::Json, false) => {
                let whole = doc! { "runs": runs, "scores": scores };
                return Ok(context.output.line(&shell::pretty(&Bson::Document(whole)))?);
            }
            (_, true) | (Format::Jsonl, false) => scores,
            (Format::Csv | Format::Tsv, false) => runs,
            (_, false) => [runs, scores].concat(),
        };
        context.print_documents(printed.into_iter().map(Ok)).map(drop)
    }
}
