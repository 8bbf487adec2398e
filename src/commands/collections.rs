//! `rmem collections`: the collections of the memory, sorted.

use super::Context;
use crate::exit::Exit;

pub(super) fn run(context: &mut Context<'_>) -> anyhow::Result<Exit> {
    for namespace in context.memory()?.collections()? {
        context.output.line(&namespace.to_string())?;
    }
    Ok(Exit::Done)
}
