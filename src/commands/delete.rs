//! `rmem delete NS QUERY`: remove the documents that match.

use super::query::{argument, blame};
use super::{Context, UsageError};
use crate::cli::Delete;
use crate::exit::Exit;

pub(super) fn run(args: &Delete, context: &mut Context<'_>) -> anyhow::Result<Exit> {
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
