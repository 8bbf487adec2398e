//! `rmem distinct NS FIELD [QUERY]`: the distinct values of a field, one a line.

use clap::Args;

use super::modifiers::ModifierArgs;
use super::query::{blame, filter_of};
use super::read::ReadArgs;
use super::{Context, UsageError, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::store::{Namespace, Query};

/// How a query is given.
const EXAMPLE: &str = "rmem distinct robmem.worldmodel object \"{relation: 'on-table'}\"";

/// Print the distinct values of a field
#[derive(Debug, Args)]
#[command(after_help = format!("Example:\n  {EXAMPLE}"))]
#[command(arg = formats::argument(&formats::VALUES))]
pub struct DistinctArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Name of the field, or a dotted path, e.g. pose.x
    #[arg(value_name = "FIELD")]
    pub field: String,
    /// Query that selects documents, or - for stdin (default: all documents)
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Which documents are read.
    #[command(flatten)]
    pub read: ReadArgs,
    /// How strings compare, variables, and the index to read.
    #[command(flatten)]
    pub modifiers: ModifierArgs,
}

pub(super) fn run(args: &DistinctArgs, context: &mut Context<'_>) -> Result<Exit> {
    if args.field.contains(['{', '[']) {
        let message =
            format!("`{}` is not the name of a field; expected NS FIELD [QUERY], like: {EXAMPLE}", args.field);
        return Err(UsageError::new(message).into());
    }
    let filter = filter_of(&args.namespace, &args.query)?;
    let memory = context.memory()?;
    args.read.apply(&args.namespace, &memory, context)?;
    let modifiers = args.modifiers.read()?;
    let query = Query { filter: &filter, modifiers: &modifiers };
    let values = memory.values(&args.namespace, &args.field, query);
    let texts = [("<query>", args.query.as_str()), args.modifiers.hint()];
    let values = values.map_err(|error| blame(error, &texts))?;
    let values = values.map(|value| value.map_err(|error| blame(error, &texts)));
    if context.print_values(values)? == 0 {
        missing::warn(&args.namespace, &memory, context);
    }
    Ok(Exit::Done)
}
