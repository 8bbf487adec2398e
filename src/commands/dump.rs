//! `rmem dump [NS…|--all] -o PATH`: namespaces as a world file.

use super::Context;
use crate::cli::Dump;
use crate::exit::Exit;
use crate::memory::world;

pub(super) fn run(args: &Dump, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let memory = context.memory()?;
    let namespaces = if args.all { memory.collections()? } else { args.namespaces.clone() };
    let text = world::dump(&memory, &namespaces)?;
    context.output.write_file(&args.output, text.as_bytes())?;
    Ok(Exit::Done)
}
