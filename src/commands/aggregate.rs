//! `rmem aggregate NS PIPELINE`: what a pipeline gives.

use clap::Args;

use super::modifiers::ModifierArgs;
use super::query::{blame, of_mongosh, owned};
use super::read::ReadArgs;
use super::{Context, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{Source, shell};
use crate::store::{Aggregation, Namespace};

/// Print the result of an aggregation pipeline
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem aggregate robmem.worldmodel '[{$group: {_id: \"$relation\", n: {$sum: 1}}}]'")]
#[command(arg = formats::argument(&formats::DOCUMENTS))]
pub struct AggregateArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Array of stages, e.g. '[{$match: {n: 1}}, {$limit: 5}]', or - for stdin
    #[arg(value_name = "PIPELINE")]
    pub pipeline: String,
    /// Which documents are read.
    #[command(flatten)]
    pub read: ReadArgs,
    /// How strings compare, variables, and the index to read.
    #[command(flatten)]
    pub modifiers: ModifierArgs,
}

pub(super) fn run(args: &AggregateArgs, context: &mut Context<'_>) -> Result<Exit> {
    let pipeline = shell::parse_pipeline(&Source::new("<pipeline>", args.pipeline.as_str()))
        .map_err(|error| of_mongosh(error, &args.namespace, &args.pipeline))?;
    let memory = context.memory()?;
    args.read.apply(&args.namespace, &memory, context)?;
    let texts = [("<pipeline>", args.pipeline.as_str()), args.modifiers.hint()];
    let documents = memory
        .aggregate(&args.namespace, Aggregation { stages: &pipeline, modifiers: &args.modifiers.read()? })
        .map_err(|error| blame(error, &texts))?;
    let documents = documents.map(|document| document.and_then(owned).map_err(|error| blame(error, &texts)));
    if context.print_documents(documents)? == 0 {
        missing::warn(&args.namespace, &memory, context);
    }
    Ok(Exit::Done)
}
