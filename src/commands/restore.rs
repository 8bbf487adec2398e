//! `rmem restore PATH`: a dump into the memory.

use std::path::{Path, PathBuf};

use bson::{Document, doc};
use clap::Args;

use super::context::STDIN;
use super::{Context, UsageError, conflict, formats};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::formats::mongodump;
use crate::input::unreadable;
use crate::memory::Memory;
use crate::memory::dump::RestoreError;
use crate::memory::dump::read::Dump;
use crate::memory::dump::restore::{Report, RestoreOptions, Restored, restore};
use crate::saturate::to_i64;
use crate::store::Namespace;

/// What stands below the help of `restore`.
const HELP: &str = "\
Examples:
  rmem restore world.json
  rmem restore backup --dry-run
  rmem restore dump/robmem/blocks.bson --into robmem.copy --drop
  rmem restore dump --oplog-replay

Reads world files, folders of rmem dump and mongodump (or of one database in them), single .bson files, and archives, \
each plain or compressed with gzip. The dump is verified first: if anything in it is wrong, nothing is changed.

Documents are merged by _id: a new document is inserted, a different one replaces the stored one, an equal one is \
skipped. With --drop, each collection is replaced as a whole, with its indexes, after everything is staged. The dates \
of insertion are those of the restore; other metadata is kept.

A dump of mongodump --oplog also has what changed while it was written. It is left out with a warning, unless \
--oplog-replay applies it behind the documents. What belongs to the server (system.users and the like) is left out \
too; --into puts such a collection into one of yours.";

/// Load a dump into the memory, after verifying it
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct RestoreArgs {
    /// World file, folder, archive or .bson file; - is a world file on stdin
    #[arg(value_name = "PATH")]
    pub path: PathBuf,
    /// Collection to restore into, if the dump has one collection (default: the dumped one)
    #[arg(long, value_name = "NS")]
    pub into: Option<Namespace>,
    /// Replace collections as a whole
    #[arg(long)]
    pub drop: bool,
    /// Apply the oplog of the dump, as mongorestore --oplogReplay does
    #[arg(long, conflicts_with = "into")]
    pub oplog_replay: bool,
    /// Give documents without an _id one that follows from their content
    #[arg(long)]
    pub add_ids: bool,
    /// Print what would be done, and change nothing
    #[arg(long)]
    pub dry_run: bool,
}

pub(super) fn run(args: &RestoreArgs, context: &mut Context<'_>) -> Result<Exit> {
    let dump = dump(args, context)?;
    let progress = context.output.progress(&format!("restoring {}", args.path.display()));
    let memory = context.memory_to_fill()?.with_meter(progress.meter());
    // What is staged has to be removed again; of what is merged, it is said how much stays.
    let guard = (!args.dry_run).then(crate::interrupt::InterruptGuard::new);
    let stop = guard.as_ref().map(crate::interrupt::InterruptGuard::interrupted);
    let temporary = context.temporary();
    let options = RestoreOptions {
        drop: args.drop,
        replay: args.oplog_replay,
        dry_run: args.dry_run,
        temporary: Some(&temporary),
        stop,
    };
    let report = match restore(&memory, &dump, options) {
        Err(interrupted @ RestoreError::Interrupted(_)) => {
            context.output.error(&interrupted.to_string());
            return Ok(Exit::Interrupted);
        }
        Err(error) => return Err(explain(error, args, &memory)),
        Ok(report) => report,
    };
    drop(progress);
    warn(args, &dump, &report, context);
    context.print_rows(report.collections.iter().map(|restored| Ok(row(restored))))?;
    if args.dry_run {
        context.output.note("nothing was changed: --dry-run");
    }
    Ok(Exit::Done)
}

/// The dump that is to be restored, as the options change it.
fn dump(args: &RestoreArgs, context: &mut Context<'_>) -> Result<Dump> {
    let mut dump = match args.path == Path::new("-") {
        true => stdin(context)?,
        false => Dump::open(&args.path)?,
    };
    if let Some(namespace) = &args.into {
        dump = dump.into(namespace).map_err(|found| {
            let found: Vec<String> = found.iter().map(ToString::to_string).collect();
            UsageError::new(format!(
                "--into takes a dump of one namespace, and {} has {}",
                args.path.display(),
                if found.is_empty() { "none".to_owned() } else { found.join(", ") }
            ))
        })?;
    }
    Ok(if args.add_ids { dump.with_ids() } else { dump })
}

/// The error of a restore; where a key is taken, with the document that has it.
fn explain(error: RestoreError, args: &RestoreArgs, memory: &Memory) -> Error {
    let RestoreError::Store { which, source } = error else { return error.into() };
    // Of two in a dump that replaces the collection, none is there.
    let holder = conflict::holder(&source, memory).filter(|_| !args.drop).as_ref().map(conflict::named);
    let message = holder.map(|holder| format!("cannot restore {which}: {source}{holder}"));
    let error = Error::from(RestoreError::Store { which, source });
    message.into_iter().fold(error, Error::context)
}

/// Warns of what is not restored as it was.
fn warn(args: &RestoreArgs, dump: &Dump, report: &Report, context: &mut Context<'_>) {
    for note in dump.notes().chain(report.notes.iter().cloned()) {
        context.output.warn(&note);
    }
    if let Some(log) = dump.log.as_ref().filter(|_| !args.oplog_replay) {
        let name = log.name();
        context.output.warn(&format!("{name}, what changed during the dump, is left out; --oplog-replay applies it"));
    }
    for restored in &report.collections {
        for index in &restored.without {
            context.output.warn(&format!("{}: {index}", restored.namespace));
        }
    }
}

/// The world file on stdin, which may be packed.
pub(super) fn stdin(context: &mut Context<'_>) -> Result<Dump> {
    let stdin = mongodump::unpack(context.take_stdin()?).map_err(|error| unreadable("stdin", &error))?;
    Ok(Dump::stream(STDIN, stdin)?)
}

/// What was done for a collection.
fn row(restored: &Restored) -> Document {
    let count = to_i64::<u64>;
    let mut row = doc! {
        "namespace": restored.namespace.to_string(),
        "inserted": count(restored.inserted),
        "replaced": count(restored.replaced),
        "skipped": count(restored.skipped),
    };
    if let Some(dropped) = restored.dropped {
        row.insert("dropped", count(dropped));
    }
    if restored.replayed > 0 {
        row.insert("oplog", count(restored.replayed));
    }
    row
}
