//! `rmem clips export|import|run`: documents to CLIPS facts and back, and CLIPS itself.

mod export;
mod import;
mod run;
mod schema;

use clap::{Args, Subcommand};

use super::Context;
use crate::error::Result;
use crate::exit::Exit;

/// What stands below the help of `clips`.
const HELP: &str = "\
Examples:
  rmem clips export robmem.worldmodel --as deffacts world -o world.clp
  rmem clips import facts.txt --into robmem.worldmodel
  rmem clips run agent.clp";

/// Convert documents to and from facts, and run CLIPS programs
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct ClipsArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: ClipsCommand,
}

/// The commands of `clips`.
#[derive(Debug, Subcommand)]
pub enum ClipsCommand {
    Export(export::ExportArgs),
    Import(import::ImportArgs),
    Run(run::RunArgs),
}

pub(super) fn run(args: &ClipsArgs, context: &mut Context<'_>) -> Result<Exit> {
    match &args.command {
        ClipsCommand::Export(args) => export::run(args, context),
        ClipsCommand::Import(args) => import::run(args, context),
        ClipsCommand::Run(args) => run::run(args, context),
    }
}
