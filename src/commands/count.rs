//! `rmem count NS [QUERY]`: how many documents match.

use clap::Args;

use super::Context;
use super::query::{argument, blame};
use crate::exit::Exit;
use crate::store::Namespace;

/// Count the documents that match
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem count robmem.worldmodel \"{relation: 'on'}\"")]
pub struct CountArgs {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Which documents; all where it is left out
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
}

pub(super) fn run(args: &CountArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let filter = argument("<query>", &args.query)?;
    let count = context.memory()?.count(&args.namespace, &filter);
    let count = count.map_err(|error| blame(error, &[("<query>", &args.query)]))?;
    context.output.line(&count.to_string())?;
    Ok(Exit::Done)
}
