//! `rmem plan` itself: a problem from the memory, a plan for it, and the plan into the memory.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use bson::{Bson, DateTime, doc};

use crate::cli;
use crate::commands::gen_problem::{generate, read_domain};
use crate::commands::{Context, UsageError};
use crate::exit::Exit;
use crate::formats::{Diagnostics, Source, pddl::Dialect, shell};
use crate::memory::Memory;
use crate::output::Format;
use crate::pddl::{Domain, Problem};
use crate::plan::{self, Answered, Lineage};
use crate::planner::{self, Host, Limits, Outcome, Planner, Race, Run, Task};
use crate::problem::{Generated, SectionReport, names};
use crate::store::stamp;

pub(super) fn run(args: &cli::PlanSearch, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let format = context.format(&[Format::Text, Format::Json, Format::Clips, Format::Ff, Format::Dot])?;
    let planners =
        args.planner.iter().map(|name| choose(name, args.anytime, context)).collect::<Result<Vec<_>, _>>()?;
    let domain = read_domain(&args.domain, args.options.lenient, context)?;
    let memory = context.memory()?;
    let posed = pose(args, &domain, &memory, context)?;
    let run = search(&planners, &Task { domain: &domain, problem: &posed.problem }, args, context)?;
    let id = if args.no_store { None } else { Some(store(&run, args, &domain, &posed, &memory, context)?) };
    print(&run, &domain, format, id.as_deref().unwrap_or("plan"), args, context)
}

/// A problem, and what is known about where it came from.
struct Posed {
    problem: Problem,
    template: Option<Source>,
    generated: Option<Generated>,
    started: DateTime,
    took: Duration,
}

/// Reads the problem, or generates it from the template, and checks it against the domain.
fn pose(args: &cli::PlanSearch, domain: &Domain, memory: &Memory, context: &mut Context<'_>) -> anyhow::Result<Posed> {
    let (started, clock) = (DateTime::now(), Instant::now());
    let dialect = Dialect { lenient: args.options.lenient };
    let (problem, template, generated) = match (&args.problem, &args.template) {
        (Some(path), _) => {
            let source = context.read(path)?;
            (Problem::read(&source, domain, dialect).map_err(Diagnostics)?, None, None)
        }
        (None, Some(path)) => {
            let template = context.read(path)?;
            let generated = generate(&template, &args.options, memory, context)?;
            let problem = generated.check(domain, dialect).map_err(Diagnostics)?;
            (problem, Some(template), Some(generated))
        }
        (None, None) => return Err(UsageError::new("expected --problem or --template").into()),
    };
    Ok(Posed { problem, template, generated, started, took: clock.elapsed() })
}

/// The planner of that name: one of rmem's own or of the settings.
fn choose(name: &str, anytime: bool, context: &Context<'_>) -> Result<Box<dyn Planner>, UsageError> {
    let configured = context.settings.planners.iter().find(|planner| planner.name == name);
    if let Some(configured) = configured {
        return Ok(Box::new(configured.clone()));
    }
    planner::by_name(name, anytime).ok_or_else(|| {
        let mut known = vec!["builtin", "ff", "fast-downward"];
        known.extend(context.settings.planners.iter().map(|planner| planner.name.as_str()));
        UsageError::new(format!("there is no planner `{name}`; expected one of {}", known.join(", ")))
    })
}

/// Runs the planners; of several, the winner's run is what counts.
fn search(
    planners: &[Box<dyn Planner>],
    task: &Task<'_>,
    args: &cli::PlanSearch,
    context: &mut Context<'_>,
) -> anyhow::Result<Run> {
    let limits = Limits { time: Some(args.timeout), memory: args.memory_limit, ..Limits::default() };
    let patience = crate::Patience::new();
    let host = Host {
        exe: context.executable.clone(),
        temporary: context.environment.get("TMPDIR").map_or_else(|| "/tmp".into(), Into::into),
        interrupted: patience.interrupted(),
    };
    let start = Instant::now();
    let race = planner::race(planners, task, &limits, &host);
    if let Some(race) = race.as_ref().filter(|race| race.runs.len() > 1) {
        context.output.note(&race.to_string());
    }
    let run = race.as_ref().and_then(Race::winner).ok_or_else(|| UsageError::new("expected --planner"))?.clone();
    context.output.operation("plan", &run.planner, run.outcome.word(), start.elapsed());
    if let Some(reason) = &run.unjudged {
        context.output.warn(&format!("the plan was not simulated: {reason}"));
    }
    Ok(run)
}

/// Stores the plan, or that there is none, with its lineage.
fn store(
    run: &Run,
    args: &cli::PlanSearch,
    domain: &Domain,
    posed: &Posed,
    memory: &Memory,
    context: &mut Context<'_>,
) -> anyhow::Result<String> {
    let layout = layout(args);
    let mut document = match &run.outcome {
        Outcome::Plan(plan) => plan::to_document(plan, domain.tree(), layout, &value),
        other => plan::failure(other.word(), layout),
    };
    document.insert(stamp::INFO, doc! { "lineage": lineage(run, args, domain, posed).to_document() });
    let inserted = memory.insert(&args.into, vec![document]).context("storing the plan")?;
    let id = match inserted.ids.first() {
        Some(Bson::ObjectId(id)) => id.to_hex(),
        other => other.map(shell::relaxed_value).unwrap_or_default(),
    };
    context.output.note(&format!("stored in {} as {id}", args.into));
    Ok(id)
}

fn layout(args: &cli::PlanSearch) -> plan::Layout {
    match args.layout {
        cli::Layout::Numbered => plan::Layout::Numbered,
        cli::Layout::Fawkes => plan::Layout::Fawkes,
    }
}

fn lineage(run: &Run, args: &cli::PlanSearch, domain: &Domain, posed: &Posed) -> Lineage {
    let goal = args.options.goal.clone().unwrap_or_else(|| goal(&posed.problem));
    let sections = posed.generated.iter().flat_map(|generated| &generated.sections);
    let lineage = Lineage {
        domain: plan::hash(domain.source().text()),
        problem: plan::hash(posed.problem.source().text()),
        template: posed.template.as_ref().map(|template| plan::hash(template.text())),
        goal,
        queries: sections.map(answered).collect(),
        started: Some(posed.started),
        times: vec![("pose".to_owned(), posed.took)],
        ..Lineage::default()
    };
    lineage.with_run(run)
}

/// The goal as PDDL.
fn goal(problem: &Problem) -> String {
    problem.tree().goal.as_ref().map(ToString::to_string).unwrap_or_default()
}

fn answered(section: &SectionReport) -> Answered {
    Answered {
        name: section.name.clone(),
        namespace: section.namespace.to_string(),
        query: shell::relaxed(&section.query),
        count: section.matched,
    }
}

/// The memory's value for a name of the problem.
fn value(name: &str) -> Bson {
    Bson::String(names::restore(name))
}

/// Prints the plan; says why there is none.
fn print(
    run: &Run,
    domain: &Domain,
    format: Format,
    id: &str,
    args: &cli::PlanSearch,
    context: &mut Context<'_>,
) -> anyhow::Result<Exit> {
    let Outcome::Plan(found) = &run.outcome else {
        let mut text = match (&run.outcome, run.message.as_str()) {
            (Outcome::Failed, said) if !said.is_empty() => format!("{}: {said}", run.planner),
            (outcome, "") => format!("{}: {}", run.planner, outcome.sentence()),
            (outcome, said) => format!("{}: {}: {said}", run.planner, outcome.sentence()),
        };
        if matches!(run.outcome, Outcome::Failed) && !run.tail().is_empty() {
            text = format!("{text}\n  its last words:\n{}", indent(&run.tail()));
        }
        context.output.error(&text);
        return Ok(Exit::from(&run.outcome));
    };
    let text = match format {
        Format::Json if args.layout == cli::Layout::Fawkes => {
            shell::relaxed(&plan::to_document(found, domain.tree(), layout(args), &value)) + "\n"
        }
        _ => plan::print(found, spelling(format), domain.tree(), id, &value)?,
    };
    context.output.stdout().write_all(text.as_bytes())?;
    Ok(Exit::Done)
}

fn spelling(format: Format) -> plan::Format {
    match format {
        Format::Json => plan::Format::Json,
        Format::Clips => plan::Format::Clips,
        Format::Ff => plan::Format::Ff,
        Format::Dot => plan::Format::Dot,
        _ => plan::Format::Text,
    }
}

/// A planner's words, with control characters made visible: they are not for this terminal to obey.
fn indent(text: &str) -> String {
    let visible = |c: char| if c.is_control() && c != '\t' { c.escape_debug().to_string() } else { c.to_string() };
    text.lines()
        .map(|line| format!("    {}", line.chars().map(visible).collect::<String>()))
        .collect::<Vec<_>>()
        .join("\n")
}
