//! `rmem drop NS`: remove a whole collection.

use clap::Args;

use super::Context;
use crate::error::Result;
use crate::exit::Exit;
use crate::store::Namespace;

/// Remove a collection with all its documents and indexes
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem drop robmem.worldmodel")]
pub struct DropArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
}

pub(super) fn run(args: &DropArgs, context: &mut Context<'_>) -> Result<Exit> {
    if !context.memory()?.drop_collection(&args.namespace)? {
        context.output.warn(&format!("there is no collection {}", args.namespace));
    }
    Ok(Exit::Done)
}
