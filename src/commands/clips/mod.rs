//! `rmem clips export|import|run`: documents to CLIPS facts and back, and CLIPS itself.

mod export;
mod import;
mod run;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::Context;
use crate::clips::facts::Schema;
use crate::exit::Exit;
use crate::formats::clips::{Item, Reader};

/// What stands below the help of `clips`.
const HELP: &str = "\
Examples:
  rmem clips export robmem.worldmodel --as deffacts world -o world.clp
  rmem clips import facts.txt --into robmem.worldmodel
  rmem clips run agent.clp";

/// Convert documents to and from CLIPS facts, and run CLIPS programs
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

pub(super) fn run(args: &ClipsArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    match &args.command {
        ClipsCommand::Export(args) => export::run(args, context),
        ClipsCommand::Import(args) => import::run(args, context),
        ClipsCommand::Run(args) => run::run(args, context),
    }
}

/// The templates of files; facts in them are not looked at.
fn schema(paths: &[PathBuf], context: &mut Context<'_>) -> anyhow::Result<Schema> {
    let mut schema = Schema::default();
    for path in paths {
        let source = context.read(path)?;
        for item in Reader::of_templates(&source) {
            if let Item::Template(template) = item? {
                schema.add(template);
            }
        }
    }
    Ok(schema)
}
