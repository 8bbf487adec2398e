//! `rmem plan` itself: a problem from the memory, a plan for it, and the plan into the memory.

use std::panic::resume_unwind;
use std::thread;
use std::time::Instant;

use anyhow::Context as _;
use bson::{Bson, Document, doc};

use super::pose::{self, PlanningTask, Sections, pose};
use super::{show, watch};
use crate::cli;
use crate::commands::{Context, UsageError};
use crate::exit::Exit;
use crate::formats::shell;
use crate::memory::Memory;
use crate::pddl::Domain;
use crate::plan::{self, TaskSource};
use crate::planner::{self, Ff, Host, Limits, Outcome, Planner, Portfolio, Race, Run, Task};
use crate::problem::names;
use crate::store::{Namespace, metadata};

/// What a planner may print on one stream, or write as its plan: more is no plan, and reading it takes long.
const MOST_OUTPUT: u64 = 16 << 20;

pub(super) fn run(args: &cli::PlanSearch, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    context.format(&show::FORMATS)?;
    choose(&args.effort, context)?;
    let recipe = pose::recipe(&args.task, context)?;
    let domain = pose::domain(&recipe)?;
    let memory = context.memory()?;
    let sections = Sections::from(&args.task.options);
    let order = PlanRequest { recipe, domain, sections, effort: &args.effort, rerun_of: None };
    match args.watch {
        true => watch::run(order, &memory, context),
        false => Ok(find(&order, &memory, context)?.exit),
    }
}

/// What came of looking for a plan.
pub(super) struct Found {
    pub(super) exit: Exit,
    /// The id under which it is stored, or that there is none is.
    pub(super) id: String,
    /// What the problem was made from.
    pub(super) namespaces: Vec<Namespace>,
}

/// A plan wanted.
pub(super) struct PlanRequest<'a> {
    pub(super) recipe: TaskSource,
    pub(super) domain: Domain,
    pub(super) sections: Sections,
    pub(super) effort: &'a cli::PlanEffort,
    pub(super) rerun_of: Option<String>,
}

/// Poses the problem, finds a plan, checks it, stores it, prints it.
pub(super) fn find(order: &PlanRequest<'_>, memory: &Memory, context: &mut Context<'_>) -> anyhow::Result<Found> {
    let planners = choose(order.effort, context)?;
    let limits = Limits { time: Some(order.effort.timeout), memory: order.effort.memory_limit, output: MOST_OUTPUT };
    let host = context.host();
    let (portfolio, posed) = thread::scope(|scope| {
        let lining_up = scope.spawn(|| {
            // An interruption waits until there is somebody to clear up after rmem.
            let guard = crate::InterruptGuard::new();
            let portfolio = Portfolio::new(&planners, &limits, &host);
            guard.end();
            portfolio
        });
        let posed = pose(&order.recipe, &order.domain, order.sections, memory, context);
        (lining_up.join().unwrap_or_else(|panic| resume_unwind(panic)), posed)
    });
    let posed = posed?;
    let task = Task { domain: &order.domain, problem: &posed.problem };
    let race = search(portfolio, &task, order.effort, memory, context)?;
    let mut run = race.winner().ok_or_else(|| UsageError::new("expected --planner"))?.clone();
    run.explain(&task);
    let document = document(&run, order, &posed);
    // What was broken off says nothing about the task.
    let id = match order.effort.no_store || run.outcome == Outcome::Interrupted {
        true => "plan".to_owned(),
        false => store(with_lineage(&document, &run, &race, order, &posed), &order.effort.into, memory, context)?,
    };
    let exit = print(&run, &document, &posed, &id, context)?;
    let namespaces = posed.generated.map(|generated| generated.namespaces).unwrap_or_default();
    Ok(Found { exit, id, namespaces })
}

fn choose(effort: &cli::PlanEffort, context: &Context<'_>) -> Result<Vec<Box<dyn Planner>>, UsageError> {
    effort.planner.iter().map(|name| by_name(name, effort.anytime, context)).collect()
}

/// The planner of that name: one of rmem's own or of the settings.
fn by_name(name: &str, anytime: bool, context: &Context<'_>) -> Result<Box<dyn Planner>, UsageError> {
    let configured = context.settings.planners.iter().find(|planner| planner.name == name);
    if let Some(configured) = configured {
        return Ok(Box::new(configured.clone()));
    }
    if name == "ff" {
        // What it can do depends on which program that is.
        return Ok(Box::new(context.program(name).map_or_else(Ff::default, |path| Ff { program: path.into() })));
    }
    planner::by_name(name, anytime).ok_or_else(|| {
        let mut known = vec!["builtin", "ff", "fast-downward"];
        known.extend(context.settings.planners.iter().map(|planner| planner.name.as_str()));
        UsageError::new(format!("there is no planner `{name}`; expected one of {}", known.join(", ")))
    })
}

/// Runs the planners, and says what several of them did.
fn search(
    portfolio: Portfolio<'_>,
    task: &Task<'_>,
    args: &cli::PlanEffort,
    memory: &Memory,
    context: &mut Context<'_>,
) -> anyhow::Result<Race> {
    let guard = crate::InterruptGuard::new();
    let host = Host { interrupted: guard.interrupted(), ..context.host() };
    let start = Instant::now();
    let meanwhile = || {
        if !args.no_store {
            memory.prepare(&args.into);
        }
    };
    let race = portfolio.race(task, &host, meanwhile).ok_or_else(|| UsageError::new("expected --planner"))?;
    if race.runs.len() > 1 {
        context.output.note(&race.to_string());
    }
    if let Some(run) = race.winner() {
        context.output.operation("plan", &run.planner, run.outcome.word(), start.elapsed());
        if let Some(reason) = &run.unjudged {
            context.output.warn(&format!("the plan was not simulated: {reason}"));
        }
        if run.is_spaced {
            context.output.note(&format!("{} lets actions touch; the plan has them apart", run.planner));
        }
    }
    Ok(race)
}

/// The document of the plan, or of there being none.
fn document(run: &Run, order: &PlanRequest<'_>, posed: &PlanningTask) -> Document {
    let layout = layout(order.effort.layout);
    match &run.outcome {
        Outcome::Plan(plan) => plan::to_document(plan, order.domain.tree(), layout, &|name| posed.value(name)),
        other => plan::failure(other.word(), layout),
    }
}

pub(super) fn layout(layout: cli::Layout) -> plan::Layout {
    match layout {
        cli::Layout::Numbered => plan::Layout::Numbered,
        cli::Layout::Fawkes => plan::Layout::Fawkes,
    }
}

fn with_lineage(
    document: &Document,
    run: &Run,
    race: &Race,
    order: &PlanRequest<'_>,
    posed: &PlanningTask,
) -> Document {
    let mut lineage = posed.lineage(order.recipe.clone()).with_run(run).with_race(race);
    lineage.planners.clone_from(&order.effort.planner);
    lineage.anytime = order.effort.anytime;
    lineage.timeout = Some(order.effort.timeout);
    lineage.memory_limit = order.effort.memory_limit;
    lineage.rerun_of.clone_from(&order.rerun_of);
    let mut document = document.clone();
    document.insert(metadata::INFO, doc! { "lineage": lineage.to_document() });
    document
}

/// Stores a plan's document with its lineage.
pub(super) fn store(
    document: Document,
    into: &Namespace,
    memory: &Memory,
    context: &mut Context<'_>,
) -> anyhow::Result<String> {
    let inserted = memory.insert(into, vec![document]).context("storing the plan")?;
    let id = match inserted.ids.first() {
        Some(Bson::ObjectId(id)) => id.to_hex(),
        other => other.map(shell::relaxed_value).unwrap_or_default(),
    };
    context.output.note(&format!("stored in {into} as {id}"));
    Ok(id)
}

/// Prints the plan; says why there is none.
fn print(
    run: &Run,
    document: &Document,
    posed: &PlanningTask,
    id: &str,
    context: &mut Context<'_>,
) -> anyhow::Result<Exit> {
    let Outcome::Plan(found) = &run.outcome else {
        let mut text = match (&run.outcome, run.message.as_str()) {
            (Outcome::Failed, said) if !said.is_empty() => format!("{}: {said}", run.planner),
            (outcome, "") => format!("{}: {}", run.planner, outcome.sentence()),
            (outcome, said) => format!("{}: {}: {said}", run.planner, outcome.sentence()),
        };
        text = names::restore(&text);
        if matches!(run.outcome, Outcome::Failed) && !run.tail().is_empty() {
            text = format!("{text}\n  its last words:\n{}", indent(&run.tail()));
        }
        context.output.error(&text);
        if let Some(why) = &run.why {
            context.output.note(&names::restore(&why.to_string()));
        }
        return Ok(Exit::from(&run.outcome));
    };
    show::print(
        &plan::PrintedPlan { plan: found, document, statuses: &[], id, value: &|name| posed.value(name) },
        context,
    )?;
    Ok(Exit::Done)
}

/// A planner's words, with control characters made visible: they are not for this terminal to obey.
fn indent(text: &str) -> String {
    let visible = |c: char| if c.is_control() && c != '\t' { c.escape_debug().to_string() } else { c.to_string() };
    text.lines()
        .map(|line| format!("    {}", line.chars().map(visible).collect::<String>()))
        .collect::<Vec<_>>()
        .join("\n")
}
