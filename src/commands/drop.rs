//! `rmem drop NS`: remove a whole collection.

use super::Context;
use crate::cli::Drop;
use crate::exit::Exit;

pub(super) fn run(args: &Drop, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    if !context.memory()?.drop_collection(&args.namespace)? {
        context.output.warn(&format!("there is no collection {}", args.namespace));
    }
    Ok(Exit::Done)
}
