//! `rmem collections`: the collections of the memory, sorted.

use clap::Args;

use super::Context;
use crate::exit::Exit;

/// List the collections
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem collections")]
pub struct CollectionsArgs {}

pub(super) fn run(_: &CollectionsArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    for namespace in context.memory()?.collections()? {
        context.output.line(&namespace.to_string())?;
    }
    Ok(Exit::Done)
}
