//! `rmem count NS [QUERY]`: how many documents match.

use super::Context;
use super::query::{argument, blame};
use crate::cli::Count;
use crate::exit::Exit;

pub(super) fn run(args: &Count, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let filter = argument("<query>", &args.query)?;
    let count = context.memory()?.count(&args.namespace, &filter);
    let count = count.map_err(|error| blame(error, &[("<query>", &args.query)]))?;
    context.output.line(&count.to_string())?;
    Ok(Exit::Done)
}
