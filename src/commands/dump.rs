//! `rmem dump [NS…|--all] -o PATH`: namespaces as a world file, a folder, or an archive.

use std::path::Path;

use super::{Context, UsageError};
use crate::cli::Dump;
use crate::exit::Exit;
use crate::memory::dump::world_file::WorldDumpError;
use crate::memory::dump::{world_file, write};

pub(super) fn run(args: &Dump, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let is_world = args.output == Path::new("-") || args.output.extension().is_some_and(|end| end == "json");
    let is_world = is_world && !args.archive;
    if is_world && args.gzip {
        return Err(UsageError::new("--gzip packs the files of a folder, or an archive; expected -o PATH").into());
    }
    if args.archive && args.output == Path::new("-") {
        return Err(UsageError::new("an archive is a file; expected -o FILE").into());
    }
    let memory = context.memory()?;
    let namespaces = if args.all { memory.collections()? } else { args.namespaces.clone() };
    if is_world {
        context.output.write_with(&args.output, |out| match world_file::write(&memory, &namespaces, out) {
            Err(WorldDumpError::Write(error)) => Err(error.into()),
            written => Ok(written?),
        })?;
        return Ok(Exit::Done);
    }
    let dump = if args.archive { write::write_archive } else { write::write_folder };
    for (namespace, count) in dump(&memory, &namespaces, &args.output, args.gzip)? {
        context.output.note(&format!("{namespace}: {count} documents"));
    }
    Ok(Exit::Done)
}
