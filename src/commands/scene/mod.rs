//! `rmem scene …`: scenes for motion planners.

mod apply;
mod check;
mod diff;
mod export;
mod selection;
mod show;
mod watch;

use clap::{Args, Subcommand};

use super::Context;
use crate::error::Result;
use crate::exit::Exit;

/// Exchange scenes with motion planners
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem scene export robmem.objects --frame map --format moveit -o world.scene\n  rmem scene check robmem.objects --frame map"
)]
pub struct SceneArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: SceneCommand,
}

/// The commands of `scene`.
#[derive(Debug, Subcommand)]
pub enum SceneCommand {
    Export(export::ExportArgs),
    Diff(diff::DiffArgs),
    Apply(apply::ApplyArgs),
    Watch(watch::WatchArgs),
    Check(check::CheckArgs),
    Show(show::ShowArgs),
}

impl SceneCommand {
    /// The query that selects objects, where there is one.
    pub(super) fn query(&mut self) -> Option<&mut String> {
        let selection = match self {
            Self::Export(args) => &mut args.selection,
            Self::Watch(args) => &mut args.selection,
            Self::Check(args) => &mut args.selection,
            Self::Show(args) => &mut args.selection,
            Self::Diff(_) | Self::Apply(_) => return None,
        };
        Some(&mut selection.query)
    }
}

pub(super) fn run(args: &SceneArgs, context: &mut Context<'_>) -> Result<Exit> {
    match &args.command {
        SceneCommand::Export(args) => export::run(args, context),
        SceneCommand::Diff(args) => diff::run(args, context),
        SceneCommand::Apply(args) => apply::run(args, context),
        SceneCommand::Watch(args) => watch::run(args, context),
        SceneCommand::Check(args) => check::run(args, context),
        SceneCommand::Show(args) => show::run(args, context),
    }
}
