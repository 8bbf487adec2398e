//! `rmem plan show ID`: a stored plan, as text, JSON, a drawing, facts, or what FF prints.

use std::cell::RefCell;
use std::collections::HashMap;

use anyhow::anyhow;
use bson::Bson;
use clap::Args;

use super::stored::{self, StoredArgs};
use crate::commands::{Context, WrongInput, formats};
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::plan::{self, PrintedPlan, Status, Stored};
use crate::problem::names;
use crate::store::metadata;

pub(super) use formats::PLAN as FORMATS;

/// Print a stored plan
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem plan show last\n  rmem plan show last --format dot | dot -Tpng > plan.png\n  rmem plan show 65f0 --format svg > plan.svg\n\n\
Formats: text (as in planning competitions), json, dot, svg, clips, ff."
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
    if format == Format::Json {
        writeln!(context.output.stdout(), "{}", shell::relaxed(&document))?;
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

/// Prints a plan in the format in force.
pub(super) fn print(page: &PrintedPlan<'_>, context: &mut Context<'_>) -> anyhow::Result<()> {
    let format = match context.format(&FORMATS)? {
        Format::Text => plan::Format::Text,
        Format::Json => plan::Format::Json,
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
