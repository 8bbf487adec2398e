//! `rmem aggregate NS PIPELINE`: what a pipeline gives.

use super::{Context, query::owned};
use crate::cli::Aggregate;
use crate::exit::Exit;
use crate::formats::{Source, shell};

pub(super) fn run(args: &Aggregate, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let pipeline = shell::parse_pipeline(&Source::new("<pipeline>", args.pipeline.as_str()))?;
    let memory = context.memory()?;
    let documents = memory.aggregate(&args.namespace, &pipeline)?;
    context.print_documents(documents.map(|document| document.and_then(owned)))?;
    Ok(Exit::Done)
}
