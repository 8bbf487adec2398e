//! `rmem export …`: documents for other programs' views.

mod mcap;

use clap::{Args, Subcommand};

use super::Context;
use crate::error::Result;
use crate::exit::Exit;

/// Write documents as a log for Foxglove, PlotJuggler and rerun
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem export mcap robmem.sightings --time seen -o sightings.mcap\n\n\
Collections are written by rmem dump, CLIPS facts by rmem clips export, scenes by rmem scene export.")]
pub struct ExportArgs {
    /// Which format.
    #[command(subcommand)]
    pub command: ExportCommand,
}

/// The formats of `export`.
#[derive(Debug, Subcommand)]
pub enum ExportCommand {
    Mcap(mcap::McapArgs),
}

pub(super) fn run(args: &ExportArgs, context: &mut Context<'_>) -> Result<Exit> {
    match &args.command {
        ExportCommand::Mcap(args) => mcap::run(args, context),
    }
}
