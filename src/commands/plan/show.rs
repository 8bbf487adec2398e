//! `rmem plan show ID`: a stored plan, as text, JSON, a drawing, facts, or what FF prints.

use std::cell::RefCell;
use std::collections::HashMap;

use bson::{Bson, DateTime, Document};
use clap::{Args, ValueEnum};

use super::stored::{self, StoredArgs};
use crate::commands::{Context, UsageError, WrongInput, error, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::pddl::Plan;
use crate::plan::{self, FactLayout, Last, PrintedPlan, Progress, Record, Status, Stored};
use crate::problem::names;
use crate::store::{Namespace, metadata};
use crate::views::chart::{COLORS, timeline_height};
use crate::views::{Axis, Chart, Interval, Kind, Series};

pub(super) use formats::PLAN as FORMATS;

/// The symbol of CLIPS for nothing.
const NIL: &str = "nil";

/// Print a stored plan
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem plan show last\n  rmem plan show last --format clips --layout fawkes --goal-id ORDER-1\n  rmem plan show last --format dot | dot -Tpng > plan.png\n  rmem plan show 65f0 --format svg --lanes robot > plan.svg\n\n\
Formats: text (as in planning competitions), json (outcome, cost and steps for an executive), document (as it is stored), dot (the partial order, for Graphviz), svg (lanes of actions over time, with causal links), timeline (planned times above real ones, as SVG), clips, ff, shell (a line a step: its number, how it stands, the action and its arguments, quoted for a shell: eval \"set -- $line\")."
)]
#[command(arg = formats::argument(&formats::STORED_PLAN))]
pub struct ShowArgs {
    /// The plan.
    #[command(flatten)]
    pub plan: StoredArgs,
    /// Parameter with one lane per value in an SVG (default: the most frequent parameter)
    #[arg(long, value_name = "PARAMETER")]
    pub lanes: Option<String>,
    /// Deftemplates that facts are for: rmem, fawkes, or cx (default: rmem)
    #[arg(long, value_name = "LAYOUT", hide_possible_values = true)]
    pub layout: Option<FactLayouts>,
    /// Goal of the plan in facts for fawkes
    #[arg(long, value_name = "SYMBOL", default_value = NIL, hide_default_value = true)]
    pub goal_id: String,
    /// PDDL instance of the plan in facts for cx
    #[arg(long, value_name = "SYMBOL", default_value = NIL, hide_default_value = true)]
    pub instance: String,
}

/// For whose deftemplates facts are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FactLayouts {
    /// `plan` and `plan-action` of rmem.
    Rmem,
    /// `plan` and `plan-action` of Fawkes' executive.
    Fawkes,
    /// `pddl-plan` and `pddl-action` of CX.
    Cx,
}

pub(super) fn run(args: &ShowArgs, context: &mut Context<'_>) -> Result<Exit> {
    let format = context.format(&formats::STORED_PLAN)?;
    check_options(args, format)?;
    let memory = context.memory()?;
    let record = stored::get(&args.plan, Last::Plan, &memory, context)?;
    match format {
        Format::Document => context.output.line(&shell::relaxed(&without_metadata(&record)))?,
        Format::Json => {
            report(&record, Some(&args.plan.namespace), error::exit_of_word(&record.outcome()), context)?;
        }
        _ => print_plan(&record, format, args, context)?,
    }
    Ok(Exit::Done)
}

/// Refuses options that the format, or the layout of its facts, does not have.
fn check_options(args: &ShowArgs, format: Format) -> Result<(), UsageError> {
    if args.layout.is_some() && format != Format::Clips {
        return Err(UsageError::new("--layout is for facts; add --format clips"));
    }
    let is_fawkes = args.layout == Some(FactLayouts::Fawkes);
    if args.goal_id != NIL && !is_fawkes {
        let cx = if args.layout == Some(FactLayouts::Cx) { "; facts for cx have an --instance" } else { "" };
        return Err(UsageError::new(format!("--goal-id is for --format clips --layout fawkes{cx}")));
    }
    if args.instance != NIL && args.layout != Some(FactLayouts::Cx) {
        return Err(UsageError::new("--instance is for --format clips --layout cx"));
    }
    Ok(())
}

fn without_metadata(record: &Record) -> Document {
    let mut document = record.document.clone();
    document.remove(metadata::INFO);
    document
}

/// Prints the steps of a stored plan, as text, facts or a drawing.
fn print_plan(record: &Record, format: Format, args: &ShowArgs, context: &mut Context<'_>) -> Result<()> {
    let (id, document) = (record.id(), without_metadata(record));
    // The memory's own values, with their types, by the names that stand for them here.
    let values = RefCell::new(HashMap::new());
    let name = |value: &Bson| {
        let name = plan::spelled(value)?;
        values.borrow_mut().insert(name.clone(), value.clone());
        Some(name)
    };
    let found = match record.plan(&name).map_err(|error| stored::broken(&id, &error))? {
        Stored::Plan(plan) => plan,
        Stored::Failure(outcome) => {
            let outcome = outcome.unwrap_or_else(|| "none was found".to_owned());
            return Err(WrongInput::new(format!("{id} has no plan: {outcome}")).into());
        }
    };
    if format == Format::Timeline {
        let chart = timeline(&found, &record.progress(), format!("plan {id}"));
        context.output.stdout().write_all(chart.draw()?.svg().as_bytes())?;
        return Ok(());
    }
    let statuses: Vec<Status> = record.progress().iter().map(|progress| progress.status).collect();
    let values = values.into_inner();
    let value = |name: &str| values.get(name).cloned().unwrap_or_else(|| Bson::String(names::restore(name)));
    let domain = record.source().ok().and_then(|source| source.read_domain().ok());
    let structure = domain.as_ref().map(|domain| domain.structure(&found.steps));
    let printed = PrintedPlan {
        plan: &found,
        document: &document,
        statuses: &statuses,
        id: &id,
        value: &value,
        structure: structure.as_ref(),
        has_metric: record.lineage().is_some_and(|lineage| lineage.get_str("metric").is_ok()),
        is_temporal: domain.is_some_and(|domain| domain.is_temporal()),
        lanes: args.lanes.as_deref(),
    };
    if let (Format::Svg, Some(lanes)) = (format, &args.lanes) {
        check_lanes(lanes, &printed)?;
    }
    let layout = match args.layout {
        None | Some(FactLayouts::Rmem) => return print(&printed, context),
        Some(FactLayouts::Fawkes) => FactLayout::Fawkes { goal: &args.goal_id },
        Some(FactLayouts::Cx) => FactLayout::Cx { instance: &args.instance },
    };
    let text = printed.facts(layout)?;
    context.output.stdout().write_all(text.as_bytes())?;
    Ok(())
}

/// Refuses a parameter that no step has.
fn check_lanes(lanes: &str, printed: &PrintedPlan<'_>) -> Result<(), WrongInput> {
    let known = printed.possible_lanes();
    if known.contains(&lanes) {
        return Ok(());
    }
    Err(WrongInput::new(format!("--lanes: no step has a `{lanes}`; expected one of {}", known.join(", "))))
}

/// Prints the report of a plan or a failure, for programs.
pub(super) fn report(
    record: &Record,
    namespace: Option<&Namespace>,
    exit: Exit,
    context: &mut Context<'_>,
) -> Result<()> {
    let namespace = namespace.map(Namespace::to_string);
    let report = record.report(namespace.as_deref(), exit.code());
    Ok(context.output.line(&shell::relaxed(&report))?)
}

/// What was planned above what was done, in seconds since the first step began. Steps without times take one each.
fn timeline(plan: &Plan, progress: &[Progress], title: String) -> Chart {
    let label = |index: usize| {
        plan.steps.get(index).map_or_else(String::new, |step| {
            format!("{} {} {}", index + 1, step.action, step.arguments.join(" ")).trim_end().to_owned()
        })
    };
    let planned = plan.steps.iter().enumerate().map(|(index, step)| {
        let from = step.start.unwrap_or(index as f64);
        Interval {
            label: label(index),
            from,
            to: from + step.duration.unwrap_or(1.0),
            color: Some("#999999".to_owned()),
        }
    });
    let seconds = |date: DateTime| date.timestamp_millis() as f64 / 1000.0;
    let first = progress.iter().filter_map(|one| one.started.or(one.ended)).map(seconds).fold(f64::INFINITY, f64::min);
    let done = progress.iter().enumerate().filter_map(|(index, one)| {
        let from = seconds(one.started.or(one.ended)?) - first;
        let to = one.ended.map_or(from, |ended| seconds(ended) - first);
        let color = match one.status {
            Status::Failed => COLORS[1],
            Status::Done => COLORS[2],
            Status::Open | Status::Running => COLORS[0],
        };
        Some(Interval { label: label(index), from, to: to.max(from), color: Some(color.to_owned()) })
    });
    let series =
        |name: &str, intervals: Vec<Interval>| Series { name: name.to_owned(), intervals, ..Series::default() };
    let mut all = vec![series("planned", planned.collect()), series("done", done.collect())];
    all.retain(|series| !series.is_empty());
    let height = timeline_height(&all);
    let axis = |label: &str| Axis { label: label.to_owned(), ..Axis::default() };
    Chart { title, x: axis("time (s)"), y: axis(""), kind: Kind::Timeline, series: all, size: (900.0, height) }
}

/// Prints a plan in the format in force.
pub(super) fn print(page: &PrintedPlan<'_>, context: &mut Context<'_>) -> Result<()> {
    let format = match context.format(&FORMATS)? {
        Format::Text => plan::Format::Text,
        Format::Document => plan::Format::Document,
        Format::Clips => plan::Format::Clips,
        Format::Ff => plan::Format::Ff,
        Format::Shell => plan::Format::Shell,
        Format::Dot => plan::Format::Dot,
        Format::Svg => plan::Format::Svg,
        other => return Err(WrongInput::new(format!("a plan has no format `{}`", other.name())).into()),
    };
    let text = page.print(format)?;
    context.output.stdout().write_all(text.as_bytes())?;
    Ok(())
}
