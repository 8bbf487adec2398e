//! `rmem collections`: the collections of the memory, sorted.

use clap::Args;

use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;

/// List the collections
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem collections", arg = formats::argument(&formats::TEXT))]
pub struct CollectionsArgs {}

pub(super) fn run(_: &CollectionsArgs, context: &mut Context<'_>) -> Result<Exit> {
    let names = context.memory()?.collections()?.into_iter().map(|namespace| namespace.to_string());
    context.print_lines(names.map(|name| (name.clone(), name.into())))?;
    Ok(Exit::Done)
}
