//! `rmem count NS [QUERY]`: how many documents match.

use clap::Args;

use super::at::AtArgs;
use super::modifiers::ModifierArgs;
use super::query::{blame, filter_of};
use super::read::ReadArgs;
use super::{Context, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::store::{Namespace, Query};

/// Count the documents that match a query
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem count robmem.worldmodel \"{relation: 'on'}\"")]
#[command(arg = formats::argument(&formats::VALUES))]
pub struct CountArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Query that selects documents, or - for stdin (default: all documents)
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Which documents are read.
    #[command(flatten)]
    pub read: ReadArgs,
    /// The memory as it was.
    #[command(flatten)]
    pub past: AtArgs,
    /// How strings compare, variables, and the index to read.
    #[command(flatten)]
    pub modifiers: ModifierArgs,
}

pub(super) fn run(args: &CountArgs, context: &mut Context<'_>) -> Result<Exit> {
    let filter = filter_of(&args.namespace, &args.query)?;
    let memory = args.past.memory(context)?;
    args.read.apply(&args.namespace, &memory, context)?;
    let count = memory.count(&args.namespace, Query { filter: &filter, modifiers: &args.modifiers.read()? });
    let count = count.map_err(|error| blame(error, &[("<query>", &args.query), args.modifiers.hint()]))?;
    context.output.line(&count.to_string())?;
    if count == 0 {
        missing::warn(&args.namespace, &memory, context);
    }
    Ok(Exit::Done)
}
