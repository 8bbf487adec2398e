//! `rmem delete NS QUERY`: remove the documents that match.

use clap::Args;

use super::query::{argument, blame};
use super::{Context, UsageError};
use crate::exit::Exit;
use crate::store::Namespace;

/// Remove the documents that match
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem delete robmem.worldmodel \"{relation: 'holding'}\"")]
pub struct DeleteArgs {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Which documents; an empty query needs --all
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// The first match only
    #[arg(long)]
    pub one: bool,
    /// Really all documents of the collection
    #[arg(long, conflicts_with = "one")]
    pub all: bool,
}

pub(super) fn run(args: &DeleteArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let filter = argument("<query>", &args.query)?;
    if filter.is_empty() && !args.all && !args.one {
        return Err(UsageError::new(format!(
            "an empty query would remove every document of {}; say --all if that is meant",
            args.namespace
        ))
        .into());
    }
    let deleted = context.memory()?.delete(&args.namespace, &filter, args.one);
    let deleted = deleted.map_err(|error| blame(error, &[("<query>", &args.query)]))?;
    context.output.line(&deleted.to_string())?;
    Ok(Exit::Done)
}
