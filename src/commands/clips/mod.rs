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

/// Turn documents into CLIPS facts, and facts into documents
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem clips export robmem.worldmodel \"{relation: 'on'}\" --as deffacts world -o world.clp\n  rmem clips import facts.txt --into robmem.worldmodel"
)]
pub struct ClipsArgs {
    /// Which way.
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
