//! `rmem plan list`: the stored plans, the newest first.

use bson::{Bson, Document};

use crate::cli::PlanList;
use crate::commands::Context;
use crate::exit::Exit;
use crate::plan::{Record, Repository, Status};
use crate::store::metadata;

pub(super) fn run(args: &PlanList, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let memory = context.memory()?;
    let plans = Repository::new(&memory, &args.namespace).newest(args.limit)?;
    context.print_documents(plans.map(|plan| Ok(line(&plan?))))?;
    Ok(Exit::Done)
}

/// What a list says of a plan.
fn line(plan: &Record) -> Document {
    let info = plan.document.get_document(metadata::INFO).ok();
    let of = |document: Option<&Document>, key: &str| document.and_then(|document| document.get(key)).cloned();
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
    say("outcome", of(plan.lineage(), "outcome").or_else(|| of(Some(&plan.document), "plan")));
    say("steps", number(progress.len()));
    say("done", number(done));
    say("planner", of(plan.lineage(), "planner"));
    say("goal", of(plan.lineage(), "goal"));
    line
}
