//! `rmem plan list`: the stored plans, the newest first.

use bson::{Bson, Document, doc};

use crate::cli::PlanList;
use crate::commands::Context;
use crate::exit::Exit;
use crate::store::{Find, stamp};

pub(super) fn run(args: &PlanList, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let memory = context.memory()?;
    let newest = doc! { format!("{}.{}", stamp::INFO, stamp::INSERTED): -1, "_id": -1 };
    let find =
        Find { filter: doc! { "plan": { "$exists": true } }, sort: newest, limit: args.limit, ..Find::default() };
    let plans = memory.find_with_metadata(&args.namespace, &find)?;
    context.print_documents(plans.map(|plan| Ok(line(&Document::try_from(&*plan?)?))))?;
    Ok(Exit::Done)
}

/// What a list says of a plan.
fn line(plan: &Document) -> Document {
    let info = plan.get_document(stamp::INFO).ok();
    let lineage = info.and_then(|info| info.get_document("lineage").ok());
    let of = |document: Option<&Document>, key: &str| document.and_then(|document| document.get(key)).cloned();
    let mut line = Document::new();
    let mut say = |key: &str, value: Option<Bson>| {
        if let Some(value) = value {
            line.insert(key, value);
        }
    };
    say("_id", of(Some(plan), "_id"));
    say("stored", of(info, stamp::INSERTED));
    say("outcome", of(lineage, "outcome"));
    say("steps", of(lineage, "length"));
    say("planner", of(lineage, "planner"));
    say("goal", of(lineage, "goal"));
    line
}
