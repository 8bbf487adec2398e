//! `rmem dump [NS…|--all] -o PATH`: namespaces as a world file, a folder, or an archive.

use std::path::{Path, PathBuf};

use clap::Args;

use super::at::AtArgs;
use super::{Context, UsageError, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::memory::dump::world_file::WorldDumpError;
use crate::memory::dump::{world_file, write};
use crate::memory::{Listed, Memory};
use crate::output::{amount, is_stdout};
use crate::store::{Index, Namespace, index};

/// What stands below the help of `dump`.
const HELP: &str = "\
Examples:
  rmem dump robmem.worldmodel -o world.json
  rmem dump --all -o backup --gzip
  rmem dump --all -o backup.archive --archive

A PATH that ends in .json, and -, is a world file: Extended JSON to read, compare and commit. Any other path is a \
folder with DATABASE/COLLECTION.bson and .metadata.json, as mongodump writes it; it must not exist yet, or be empty, \
and appears whole or not at all.

Folders and archives keep indexes and the metadata of documents; a world file leaves out indexes, and the dates of \
insertion and update. \
Documents of computables are never dumped.";

/// Write collections to a world file or a mongodump folder
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct DumpArgs {
    /// Collections to write (can be repeated)
    #[arg(value_name = "NS", required_unless_present = "all")]
    pub namespaces: Vec<Namespace>,
    /// Write all collections
    #[arg(long, conflicts_with = "namespaces")]
    pub all: bool,
    /// World file (.json, or - for stdout) or folder to write
    #[arg(short, long, value_name = "PATH", default_value = "-")]
    pub output: PathBuf,
    /// Write one archive file, as mongodump --archive does
    #[arg(long)]
    pub archive: bool,
    /// Compress the files of the folder, or the archive
    #[arg(long)]
    pub gzip: bool,
    /// The memory as it was.
    #[command(flatten)]
    pub past: AtArgs,
}

/// All collections but views, which have no documents of their own.
fn stored(memory: &Memory, context: &mut Context<'_>) -> Result<Vec<Namespace>> {
    let mut stored = Vec::new();
    for ns in memory.collections()? {
        match memory.collection_or_view(&ns)? {
            Listed::Collection(_) => stored.push(ns),
            Listed::View(_) => context.output.warn(&format!("{ns} is a view, and was left out")),
            Listed::TimeSeries(_) => {
                context.output.warn(&format!("{ns} is a time series; from the dump, it will be a plain collection"));
                stored.push(ns);
            }
        }
    }
    Ok(stored)
}

pub(super) fn run(args: &DumpArgs, context: &mut Context<'_>) -> Result<Exit> {
    let is_file = args.output.extension().is_some_and(|end| end == "json") || is_stream(&args.output);
    let is_world = (is_stdout(&args.output) || is_file) && !args.archive;
    if is_world && args.gzip {
        return Err(UsageError::new("--gzip packs the files of a folder, or an archive; expected -o PATH").into());
    }
    if args.archive && is_stdout(&args.output) {
        return Err(UsageError::new("an archive is a file; expected -o FILE").into());
    }
    let progress = context.output.progress(&format!("writing {}", args.output.display()));
    let memory = args.past.memory(context)?.with_meter(progress.meter());
    let namespaces = if args.all { stored(&memory, context)? } else { args.namespaces.clone() };
    // What was there at another time is not known.
    if !args.all && args.past.at.is_none() {
        let messages = namespaces.iter().map(|namespace| missing::look(namespace, &memory, context));
        let absent: Vec<String> = messages.filter_map(Result::transpose).collect::<Result<_, _>>()?;
        absent.iter().for_each(|message| context.output.warn(message));
        if absent.len() == namespaces.len() {
            context.output.error("nothing was written: no such collection");
            return Ok(Exit::No);
        }
    }
    if is_world {
        context.output.write_with(&args.output, |out| match world_file::write(&memory, &namespaces, out) {
            Err(WorldDumpError::Write(error)) => Err(error.into()),
            written => Ok(written?),
        })?;
        warn_of_definitions(&memory, &namespaces, context)?;
        return Ok(Exit::Done);
    }
    let dump = if args.archive { write::write_archive } else { write::write_folder };
    for (namespace, count) in dump(&memory, &namespaces, &args.output, args.gzip)? {
        context.output.note(&format!("{namespace}: {}", amount(count, "document")));
    }
    Ok(Exit::Done)
}

/// Whether a path leads to what is written from end to end, like `/dev/stdout` or a pipe.
fn is_stream(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| !found.is_dir() && !found.is_file())
}

/// Says which indexes and options a world file has no place for.
fn warn_of_definitions(memory: &Memory, namespaces: &[Namespace], context: &mut Context<'_>) -> Result<()> {
    let mut left_out = Vec::new();
    for namespace in namespaces {
        let made = memory.indexes(namespace)?;
        left_out
            .extend(made.iter().filter(|index| is_made(index)).map(|index| format!("{} of {namespace}", index.name)));
        if index::collation(&made).is_some() {
            left_out.push(format!("the collation of {namespace}"));
        }
        if memory.validation(namespace)?.is_some() {
            left_out.push(format!("the validator of {namespace}"));
        }
    }
    if !left_out.is_empty() {
        let list = left_out.join(", ");
        context.output.warn(&format!(
            "a world file keeps no indexes, collations and validators; left out: {list}; -o FOLDER keeps them"
        ));
    }
    Ok(())
}

/// Whether a user created the index.
fn is_made(index: &Index) -> bool {
    !matches!(index.name.as_str(), "_id_" | index::DECAY)
}
