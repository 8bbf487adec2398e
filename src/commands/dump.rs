//! `rmem dump [NS…|--all] -o PATH`: namespaces as a world file, a folder, or an archive.

use std::path::{Path, PathBuf};

use clap::Args;

use super::{Context, UsageError};
use crate::exit::Exit;
use crate::memory::dump::world_file::WorldDumpError;
use crate::memory::dump::{world_file, write};
use crate::store::Namespace;

/// Write namespaces as a world file, or as a folder that MongoDB's tools read
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem dump robmem.worldmodel -o world.json\n  rmem dump --all -o backup --gzip\n  rmem dump --all -o backup.archive --archive\n\n\
A path that ends in .json, and -, is a world file; any other path is a folder with\n\
DATABASE/COLLECTION.bson and .metadata.json, as mongodump writes it. The folder may not be\n\
there yet, and appears whole or not at all. It keeps documents with their metadata; a world\n\
file leaves out when they were stored and changed. What computables made is left out."
)]
pub struct DumpArgs {
    /// Which collections
    #[arg(value_name = "NS", required_unless_present = "all")]
    pub namespaces: Vec<Namespace>,
    /// Every collection
    #[arg(long, conflicts_with = "namespaces")]
    pub all: bool,
    /// A world file (.json, or - for stdout), or a folder
    #[arg(short, long, value_name = "PATH", default_value = "-")]
    pub output: PathBuf,
    /// Write one file, as mongodump --archive does
    #[arg(long)]
    pub archive: bool,
    /// Pack the files of a folder, or the archive
    #[arg(long)]
    pub gzip: bool,
}

pub(super) fn run(args: &DumpArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
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
