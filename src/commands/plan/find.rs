//! Finding a plan for a request: the workflow, and what is printed of it.

use super::show;
use super::source::SectionCounts;
use crate::commands::{Context, UsageError};
use crate::error::Result;
use crate::exit::Exit;
use crate::interrupt::InterruptGuard;
use crate::memory::Memory;
use crate::output::{Format, Progress};
use crate::plan::{self, PrintedPlan};
use crate::planner::{self, Host, Listener, Outcome, Planner};
use crate::planning::{self, Note, PlanRequest, PlanResult, PlanningError, PreparedSearch};
use crate::store::Namespace;

/// What a search gave.
pub(super) struct Found {
    pub(super) exit: Exit,
    /// The id of the stored plan, or of the stored failure.
    pub(super) id: Option<String>,
    /// What the problem was made from.
    pub(super) namespaces: Vec<Namespace>,
}

/// Instantiates the problem, finds a plan, stores it, prints it.
pub(super) fn find(
    request: &PlanRequest,
    sections: SectionCounts,
    memory: &Memory,
    context: &mut Context<'_>,
) -> Result<Found> {
    let prepared = planning::prepare(request, memory, &context.host());
    Ok(find_prepared(request, prepared, sections, memory, context)?.0)
}

/// As [`find`], with the problem and the planners' programs; returns the result as well, of which giving back the memory may
/// take a while.
pub(super) fn find_prepared<'a>(
    request: &'a PlanRequest,
    prepared: Result<PreparedSearch<'a>, PlanningError>,
    sections: SectionCounts,
    memory: &Memory,
    context: &mut Context<'_>,
) -> Result<(Found, PlanResult<'a>)> {
    sections.report(prepared.as_ref().map(PreparedSearch::task), memory, context)?;
    let prepared = prepared?;
    sections.warn(&request.domain, prepared.task(), context);
    if request.options.anytime && !prepared.improves() {
        if let Some(refusal) = prepared.not_improved() {
            return Err(refusal.into());
        }
        let names: Vec<&str> = request.planners.iter().map(|planner| planner.name()).collect();
        let message = format!("{} cannot improve a plan of this task; leave out --anytime", names.join(", "));
        return Err(UsageError::new(message).into());
    }
    let progress = context.output.progress(&planning(request));
    let listener = listener(planning(request), &progress);
    let result = search(prepared, memory, listener, context)?;
    drop(progress);
    report(&result, context);
    refuse_unprintable(&result, context)?;
    let id = result.store(memory)?;
    if let (Some(id), Some(into)) = (&id, &request.options.into) {
        context.output.note(&format!("stored in {into} as {id}"));
    }
    let exit = print(&result, id.as_deref(), context)?;
    let generated = result.task().generated.as_ref();
    let namespaces = generated.map(|generated| generated.namespaces.clone()).unwrap_or_default();
    Ok((Found { exit, id, namespaces }, result))
}

/// Says what is being done while planners run.
fn planning(request: &PlanRequest) -> String {
    let names: Vec<&str> = request.planners.iter().map(|planner| planner.name()).collect();
    let aim = if request.options.anytime { "looking for the best plan" } else { "looking for a plan" };
    format!("{}: {aim}, at most {} s", names.join(", "), request.options.timeout.as_secs_f64())
}

/// Shows the progress of planners; none where nothing is shown.
fn listener(text: String, progress: &Progress) -> Listener {
    match progress.reporter() {
        None => Listener::default(),
        Some(reporter) => Listener::new(move |printed| {
            if let Some(words) = planner::progress(printed) {
                reporter.say(&format!("{text}, {words}"));
            }
        }),
    }
}

/// The planners with these names.
pub(super) fn choose(names: &[String], anytime: bool, context: &Context<'_>) -> Result<Vec<Box<dyn Planner>>> {
    let registry = context.planners();
    names.iter().map(|name| Ok(registry.get(name, anytime)?)).collect()
}

/// Runs the planners; while they run, an interruption ends them.
fn search<'a>(
    prepared: PreparedSearch<'a>,
    memory: &Memory,
    listener: Listener,
    context: &Context<'_>,
) -> Result<PlanResult<'a>> {
    let guard = InterruptGuard::new();
    let host = Host { interrupted: guard.interrupted(), listener, ..context.host() };
    Ok(prepared.search(memory, &host)?)
}

fn report(result: &PlanResult<'_>, context: &mut Context<'_>) {
    let run = result.run();
    context.output.operation("plan", &run.planner, run.outcome.word(), result.time());
    for note in result.notes() {
        match note {
            Note::Info(text) => context.output.note(&text),
            Note::Warning(text) => context.output.warn(&text),
        }
    }
}

/// Refuses a plan with a name that the format cannot write, before it is stored.
fn refuse_unprintable(result: &PlanResult<'_>, context: &Context<'_>) -> Result<()> {
    let value = |name: &str| result.task().value(name);
    let format = match context.format(&show::FORMATS)? {
        Format::Shell => plan::Format::Shell,
        Format::Clips => plan::Format::Clips,
        _ => return Ok(()),
    };
    if let Some(printed) = result.printed("plan", &value) {
        printed.print(format)?;
    }
    Ok(())
}

/// Prints the plan; reports why there is none.
fn print(result: &PlanResult<'_>, id: Option<&str>, context: &mut Context<'_>) -> Result<Exit> {
    if let Some(failure) = result.failure() {
        context.output.error(&failure);
    }
    if let Some(why) = result.why() {
        context.output.note(&why);
    }
    if result.run().outcome == Outcome::Unsolvable {
        context.output.note(match result.task().generated {
            Some(_) => "change the goal, or what the memory says: `rmem gen-problem --explain ATOM` shows where a fact comes from",
            None => "change the goal, the initial state, or the actions of the domain",
        });
    }
    let exit = if result.is_interrupted() { Exit::Interrupted } else { Exit::from(&result.run().outcome) };
    let format = context.format(&show::FORMATS)?;
    if format == Format::Json {
        let namespace = id.and(result.namespace());
        show::report(&result.record(id), namespace, exit, context)?;
    } else if let Some(printed) = result.printed(id.unwrap_or("plan"), &|name| result.task().value(name)) {
        let structure = matches!(format, Format::Dot | Format::Svg).then(|| result.structure());
        show::print(&PrintedPlan { structure: structure.as_ref(), ..printed }, context)?;
    }
    Ok(exit)
}
