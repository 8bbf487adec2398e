//! `rmem aggregate NS PIPELINE`: what a pipeline gives.

use super::Context;
use super::query::{blame, owned};
use crate::cli::Aggregate;
use crate::exit::Exit;
use crate::formats::{Source, shell};

pub(super) fn run(args: &Aggregate, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let pipeline = shell::parse_pipeline(&Source::new("<pipeline>", args.pipeline.as_str()))?;
    let memory = context.memory()?;
    let texts = [("<pipeline>", args.pipeline.as_str())];
    let documents = memory.aggregate(&args.namespace, &pipeline).map_err(|error| blame(error, &texts))?;
    context
        .print_documents(documents.map(|document| document.and_then(owned).map_err(|error| blame(error, &texts))))?;
    Ok(Exit::Done)
}
