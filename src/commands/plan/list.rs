//! `rmem plan list`: the stored plans, the newest first.

use bson::{Bson, Document};
use clap::Args;

use crate::commands::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::plan::{Record, Repository, Status};
use crate::problem::names;
use crate::store::{Namespace, metadata};

/// List the stored plans, newest first
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem plan list --limit 5")]
#[command(arg = formats::argument(&formats::DOCUMENTS))]
pub struct ListArgs {
    /// Collection of the plans
    #[arg(long = "in", value_name = "NS", default_value = "robmem.plans")]
    pub namespace: Namespace,
    /// List at most N plans; 0 lists all
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub limit: u64,
}

pub(super) fn run(args: &ListArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let plans = Repository::new(&memory, &args.namespace).newest(args.limit)?;
    context.print_rows(plans.map(|plan| Ok(line(&plan?))))?;
    Ok(Exit::Done)
}

/// The row of a plan.
fn line(plan: &Record) -> Document {
    let info = plan.document.get_document(metadata::INFO).ok();
    let of = |document: Option<&Document>, key: &str| document.and_then(|document| document.get(key)).cloned();
    let report = plan.report(None, 0);
    let mut line = Document::new();
    let mut say = |key: &str, value: Option<Bson>| {
        if let Some(value) = value {
            line.insert(key, value);
        }
    };
    let progress = plan.progress();
    let done = progress.iter().filter(|step| step.status == Status::Done).count();
    let number = |count: usize| i32::try_from(count).ok().map(Bson::Int32);
    say("_id", of(Some(&plan.document), "_id"));
    say("stored", of(info, metadata::INSERTED));
    say("outcome", Some(plan.outcome().into()));
    say("steps", number(progress.len()));
    say("done", number(done));
    for key in ["cost", "makespan", "seconds", "planner"] {
        say(key, of(Some(&report), key).filter(|value| *value != Bson::Null));
    }
    let goal = plan.lineage().and_then(|lineage| lineage.get_str("goal").ok());
    say("goal", goal.map(|goal| names::readable(goal).into()));
    line
}
