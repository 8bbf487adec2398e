//! `rmem plan show ID`: a stored plan, as text, JSON, a drawing, facts, or what FF prints.

use std::cell::RefCell;
use std::collections::HashMap;

use anyhow::anyhow;
use bson::Bson;
use clap::Args;

use super::stored::{self, StoredArgs};
use crate::commands::{Context, WrongInput, error, formats};
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::plan::{self, PrintedPlan, Record, Status, Stored};
use crate::problem::names;
use crate::store::{Namespace, metadata};

pub(super) use formats::PLAN as FORMATS;

/// Print a stored plan
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem plan show last\n  rmem plan show last --format dot | dot -Tpng > plan.png\n  rmem plan show 65f0 --format svg > plan.svg\n\n\
Formats: text (as in planning competitions), json (outcome, cost and steps for an executive),\n\
document (as it is stored), dot, svg, clips, ff."
)]
#[command(arg = formats::argument(&formats::PLAN))]
pub struct ShowArgs {
    /// The plan.
    #[command(flatten)]
    pub plan: StoredArgs,
}

pub(super) fn run(args: &ShowArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let format = context.format(&FORMATS)?;
    let memory = context.memory()?;
    let record = stored::get(&args.plan.id, &args.plan.namespace, &memory)?;
    let id = record.id();
    let mut document = record.document.clone();
    document.remove(metadata::INFO);
    if format == Format::Document {
        context.output.line(&shell::relaxed(&document))?;
        return Ok(Exit::Done);
    }
    if format == Format::Json {
        report(&record, Some(&args.plan.namespace), error::exit_of_word(&record.outcome()), context)?;
        return Ok(Exit::Done);
    }
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
    let statuses: Vec<Status> = record.progress().iter().map(|progress| progress.status).collect();
    let values = values.into_inner();
    let value = |name: &str| values.get(name).cloned().unwrap_or_else(|| Bson::String(names::restore(name)));
    print(&PrintedPlan { plan: &found, document: &document, statuses: &statuses, id: &id, value: &value }, context)?;
    Ok(Exit::Done)
}

/// Prints the report of a plan or a failure, for programs.
pub(super) fn report(
    record: &Record,
    namespace: Option<&Namespace>,
    exit: Exit,
    context: &mut Context<'_>,
) -> anyhow::Result<()> {
    let namespace = namespace.map(Namespace::to_string);
    let report = record.report(namespace.as_deref(), exit.code());
    Ok(context.output.line(&shell::relaxed(&report))?)
}

/// Prints a plan in the format in force.
pub(super) fn print(page: &PrintedPlan<'_>, context: &mut Context<'_>) -> anyhow::Result<()> {
    let format = match context.format(&FORMATS)? {
        Format::Text => plan::Format::Text,
        Format::Document => plan::Format::Document,
        Format::Clips => plan::Format::Clips,
        Format::Ff => plan::Format::Ff,
        Format::Dot => plan::Format::Dot,
        Format::Svg => plan::Format::Svg,
        other => return Err(anyhow!("a plan has no format `{}`", other.name())),
    };
    let text = page.print(format)?;
    context.output.stdout().write_all(text.as_bytes())?;
    Ok(())
}
