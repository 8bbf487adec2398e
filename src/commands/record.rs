//! `rmem record NS`: the history of a collection on MongoDB, of what all clients change.

use std::time::Duration;

use clap::Args;

use super::Context;
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::quantity;
use crate::interrupt::InterruptGuard;
use crate::store::Namespace;

/// What stands below the help of `record`.
const HELP: &str = "\
Examples:
  rmem record robmem.worldmodel
  rmem record robmem.worldmodel --timeout 1h

Runs until it is interrupted. On MongoDB, rmem records a change of another client when rmem next writes to the \
collection or reads its history, as long as the server's oplog reaches back; `record` does so at once. In a file, \
every write keeps the history itself.

Needs keep_history in rmem.toml, and a replica set; one member suffices. Entries are in the collection rmem.history \
of the database.";

/// Record what other clients of MongoDB change, for the history
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct RecordArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Exit after this time
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub timeout: Option<Duration>,
}

pub(super) fn run(args: &RecordArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let guard = InterruptGuard::new();
    let begun = &mut || context.output.note(&format!("recording {}", args.namespace));
    let count = memory.record(&args.namespace, args.timeout, guard.interrupted(), begun)?;
    context.output.note(&format!("recorded {count} changes of {}", args.namespace));
    Ok(if guard.interrupted().load(std::sync::atomic::Ordering::Relaxed) { Exit::Interrupted } else { Exit::Done })
}
