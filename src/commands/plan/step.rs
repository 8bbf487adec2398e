//! `rmem plan step ID N --done`: what became of a step.

use bson::{Bson, DateTime, Document, doc};
use clap::Args;

use super::stored::{self, StoredArgs};
use crate::commands::{Context, UsageError, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::pddl::{Reach, Step};
use crate::plan::{self, Last, Record, Repository, Status, Stored};
use crate::problem::names;
use crate::saturate::to_i64;
use crate::store::Namespace;

/// How far planners round times, in the plan's unit.
const ROUNDING: f64 = 1e-6;

/// Record how the execution of a step went
#[derive(Debug, Args)]
#[command(arg = formats::argument(&formats::TEXT))]
#[command(
    after_help = "Examples:\n  rmem plan step last 1 --started\n  rmem plan step last '(pick \"box #18\")' --done\n\n\
`last` is the last plan that has steps; it moves when another process plans, so that executives use the id.\n\
Steps count from 1; `next` is the first that is not done. An action like '(pick A)' is the first step that\n\
takes it and is not done. In the plan's document, the step gets\n\
the keys _status (running, done, failed), _started and _ended (dates)."
)]
pub struct StepArgs {
    /// The plan: its id, a unique prefix of it, or last
    #[arg(value_name = "ID")]
    pub id: String,
    /// The step: its number from 1, its action like '(pick A)', or next
    #[arg(value_name = "N")]
    pub step: String,
    /// What became of it.
    #[command(flatten)]
    pub state: StateArgs,
    /// Allow --started and --done although a step that has to come before is not done
    #[arg(long, conflicts_with_all = ["failed", "open"])]
    pub out_of_order: bool,
    /// Collection of the plans
    #[arg(long = "in", value_name = "NS", default_value = "robmem.plans")]
    pub namespace: Namespace,
}

/// What became of a step.
#[derive(Debug, Clone, Copy, Args)]
#[group(required = true, multiple = false)]
pub struct StateArgs {
    /// Mark it as running
    #[arg(long)]
    pub started: bool,
    /// Mark it as done
    #[arg(long)]
    pub done: bool,
    /// Mark it as failed
    #[arg(long)]
    pub failed: bool,
    /// Mark it as not started
    #[arg(long)]
    pub open: bool,
}

pub(super) fn run(args: &StepArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let repository = Repository::new(&memory, &args.namespace);
    let stored = StoredArgs { id: args.id.clone(), namespace: args.namespace.clone() };
    let plan = stored::get(&stored, Last::WithSteps, &memory, context)?;
    let number = number(&args.step, &plan)?;
    check_order(number, args, &plan)?;
    let before = plan.progress().get(number.saturating_sub(1)).map(|step| step.status).unwrap_or_default();
    let status = status(args.state);
    repository.mark(&plan, number, status, DateTime::now())?;
    let step = steps(&plan).into_iter().nth(number.saturating_sub(1)).unwrap_or_default();
    if context.format(&formats::TEXT)? == Format::Json {
        let of = |key: &str| step.get(key).cloned().unwrap_or(Bson::Null);
        let number = to_i64(number);
        let report = doc! {
            "id": plan.id(), "namespace": args.namespace.to_string(), "step": number, "action": of("action"),
            "args": of("args"), "list": of("list"), "status": status.word(),
        };
        context.output.line(&shell::relaxed(&report))?;
        return Ok(Exit::Done);
    }
    let action = names::readable(&spelled(&step));
    match before {
        _ if before == status => context.output.warn(&format!("step {number} was {status} already")),
        Status::Done => context.output.warn(&format!("step {number} was done; it is {status} again")),
        _ => {}
    }
    context.output.note(&format!("step {number} of {} is {status}: {action}", plan.id()));
    Ok(Exit::Done)
}

/// The steps of a plan, as an executive reads them.
fn steps(plan: &Record) -> Vec<Document> {
    let report = plan.report(None, 0);
    report.get_array("steps").into_iter().flatten().filter_map(Bson::as_document).cloned().collect()
}

/// `(pick x--box_20_2318--x)`
fn spelled(step: &Document) -> String {
    let action = step.get_str("action").unwrap_or_default().to_owned();
    let arguments = step.get_array("list").into_iter().flatten().filter_map(plan::spelled);
    format!("({})", std::iter::once(action).chain(arguments).collect::<Vec<_>>().join(" "))
}

/// Refuses a step that would be done before an earlier one.
fn check_order(number: usize, args: &StepArgs, plan: &Record) -> Result<(), UsageError> {
    let progress = plan.progress();
    // A step that there is not is refused by its number.
    let Some(index) = number.checked_sub(1).filter(|index| *index < progress.len()) else { return Ok(()) };
    let verb = match args.state {
        StateArgs { done: true, .. } => "done",
        StateArgs { started: true, .. } => "started",
        _ => return Ok(()),
    };
    if args.out_of_order {
        return Ok(());
    }
    let timed = timed(plan);
    let aim = if args.state.started { Reach::Begun } else { Reach::Ended };
    let waits = waits(index, aim, timed.as_deref(), plan);
    let is_waiting = |(status, reach): (Status, Option<Reach>)| match reach {
        Some(Reach::Ended) => status != Status::Done,
        Some(Reach::Begun) => matches!(status, Status::Open | Status::Failed),
        None => false,
    };
    let states = || progress.iter().map(|step| step.status).zip(waits.iter().copied());
    let Some((step, (status, reach))) = (1..).zip(states()).find(|(_, state)| is_waiting(*state)) else {
        return Ok(());
    };
    let how = if timed.is_some() && reach == Some(Reach::Begun) { " as started" } else { "" };
    Err(UsageError::new(format!(
        "step {number} cannot be {verb} while step {step} is {status}; mark step {step}{how} first, or use --out-of-order"
    )))
}

/// How far each step has to be before one of them, counted from 0, begins or is done. In a plan without times, those before
/// it have begun.
fn waits(index: usize, aim: Reach, timed: Option<&[Step]>, plan: &Record) -> Vec<Option<Reach>> {
    let Some(steps) = timed else { return vec![Some(Reach::Begun); index] };
    match plan.source().ok().and_then(|source| source.read_domain().ok()) {
        Some(domain) => domain.waits(steps, index, aim),
        None => {
            // Where the domain is not known, it waits for all that end before it starts.
            let is_before = |other: usize| other < index && ends_before(other, index, steps);
            (0..steps.len()).map(|other| is_before(other).then_some(Reach::Ended)).collect()
        }
    }
}

/// Whether a step of a plan with times ends before another one starts.
fn ends_before(step: usize, other: usize, steps: &[Step]) -> bool {
    let end = steps.get(step).and_then(|step| Some(step.start? + step.duration.unwrap_or_default()));
    let start = steps.get(other).and_then(|step| step.start);
    end.zip(start).is_some_and(|(end, start)| end <= start + ROUNDING)
}

/// The steps of a plan with times.
fn timed(plan: &Record) -> Option<Vec<Step>> {
    match plan.plan(&plan::spelled) {
        Ok(Stored::Plan(plan)) if plan.steps.iter().any(|step| step.start.is_some()) => Some(plan.steps),
        _ => None,
    }
}

fn status(state: StateArgs) -> Status {
    match state {
        StateArgs { done: true, .. } => Status::Done,
        StateArgs { failed: true, .. } => Status::Failed,
        StateArgs { started: true, .. } => Status::Running,
        _ => Status::Open,
    }
}

fn number(text: &str, plan: &Record) -> Result<usize, UsageError> {
    if text == "next" {
        let next = plan.progress().iter().position(|step| step.status != Status::Done);
        return next.map(|index| index + 1).ok_or_else(|| UsageError::new(format!("{} has no step left", plan.id())));
    }
    if text.trim_start().starts_with('(') {
        return by_action(text, plan);
    }
    text.parse().map_err(|_| {
        UsageError::new(format!(
            "`{text}` is not a step; expected a number from 1, an action like '(pick A)', or `next`"
        ))
    })
}

/// The first step with an action that is not done; names may be the memory's own.
fn by_action(text: &str, plan: &Record) -> Result<usize, UsageError> {
    let words =
        |text: &str| text.to_lowercase().replace(['(', ')'], " ").split_whitespace().collect::<Vec<_>>().join(" ");
    let wanted = words(&names::spell(text));
    let steps = steps(plan);
    let numbers = || (1..).zip(&steps).filter(|(_, step)| words(&spelled(step)) == wanted);
    let is_open = |step: &Document| step.get_str("status").is_ok_and(|status| status != Status::Done.word());
    let found = numbers().find(|(_, step)| is_open(step)).or_else(|| numbers().last());
    found.map(|(number, _)| number).ok_or_else(|| {
        let known: Vec<String> = steps.iter().map(|step| names::readable(&spelled(step))).collect();
        UsageError::new(format!("no step of {} is `{text}`; it has {}", plan.id(), known.join(" ")))
    })
}
