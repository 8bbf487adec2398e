//! `rmem backup FILE`: a copy of the memory's file while it is in use.

use std::path::PathBuf;

use bson::doc;
use clap::Args;

use super::{Context, UsageError, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::output::is_stdout;

/// Copy the memory into a new file, while other programs use it
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem backup robot-2026-11-22.rmem\n\n\
The copy is the memory as it is at one moment; other programs read and write meanwhile. It is a memory\n\
itself: use it with --memory file:FILE. Do not copy the file of a memory that is in use with cp: its\n\
latest writes are in FILE-wal beside it until they are folded into the file, which happens at the latest\n\
when the last program closes it. A MongoDB server is backed up with `rmem dump --all`.")]
#[command(arg = formats::argument(&formats::TEXT))]
pub struct BackupArgs {
    /// The new file; it must not exist
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
}

pub(super) fn run(args: &BackupArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::TEXT)?;
    if is_stdout(&args.file) {
        return Err(UsageError::new(
            "a backup is a file; expected FILE, like robot-copy.rmem (`rmem dump -o -` prints)",
        )
        .into());
    }
    let memory = context.memory()?;
    memory.backup(&args.file)?;
    let file = args.file.display().to_string();
    let copied = memory.describe_private();
    context.print_report([], doc! { "memory": &copied, "file": file })?;
    context.output.note(&format!("copied {copied} to {}", args.file.display()));
    if let Some(shared) = memory.describe_shared() {
        context.output.note(&format!("what is shared is not in the copy: {shared}"));
    }
    Ok(Exit::Done)
}
