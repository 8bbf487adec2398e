//! `rmem drop NS`: remove a whole collection.

use bson::doc;
use clap::Args;

use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::store::Namespace;

/// Remove a collection with all its documents and indexes
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem drop robmem.worldmodel", arg = formats::argument(&formats::TEXT))]
pub struct DropArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
}

pub(super) fn run(args: &DropArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::TEXT)?;
    let is_dropped = context.memory()?.drop_collection(&args.namespace)?;
    context.print_report([], doc! { "ns": args.namespace.to_string(), "dropped": is_dropped })?;
    if !is_dropped {
        context.output.warn(&format!("there is no collection {}", args.namespace));
    }
    Ok(Exit::Done)
}
