//! `rmem aggregate NS PIPELINE`: what a pipeline gives.

use clap::Args;

use super::Context;
use super::query::{blame, owned};
use crate::exit::Exit;
use crate::formats::{Source, shell};
use crate::store::Namespace;

/// Run an aggregation pipeline
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  rmem aggregate robmem.worldmodel \"[{\\$group: {_id: '\\$relation', n: {\\$sum: 1}}}]\""
)]
pub struct AggregateArgs {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// An array of stages
    #[arg(value_name = "PIPELINE")]
    pub pipeline: String,
}

pub(super) fn run(args: &AggregateArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let pipeline = shell::parse_pipeline(&Source::new("<pipeline>", args.pipeline.as_str()))?;
    let memory = context.memory()?;
    let texts = [("<pipeline>", args.pipeline.as_str())];
    let documents = memory.aggregate(&args.namespace, &pipeline).map_err(|error| blame(error, &texts))?;
    context
        .print_documents(documents.map(|document| document.and_then(owned).map_err(|error| blame(error, &texts))))?;
    Ok(Exit::Done)
}
