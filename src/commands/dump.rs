//! `rmem dump [NS…|--all] -o PATH`: namespaces as a world file, or as a folder.

use std::path::Path;

use super::{Context, UsageError};
use crate::cli::Dump;
use crate::exit::Exit;
use crate::memory::{dump, world};

pub(super) fn run(args: &Dump, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let is_world = args.output == Path::new("-") || args.output.extension().is_some_and(|end| end == "json");
    if is_world && args.gzip {
        return Err(UsageError::new("--gzip packs the files of a folder; expected -o FOLDER").into());
    }
    let memory = context.memory()?;
    let namespaces = if args.all { memory.collections()? } else { args.namespaces.clone() };
    if is_world {
        let text = world::dump(&memory, &namespaces)?;
        context.output.write_file(&args.output, text.as_bytes())?;
        return Ok(Exit::Done);
    }
    for (namespace, count) in dump::write(&memory, &namespaces, &args.output, args.gzip)? {
        context.output.note(&format!("{namespace}: {count} documents"));
    }
    Ok(Exit::Done)
}
