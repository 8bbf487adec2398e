//! `rmem backend up|status|down`: the mongod processes of this robot.

mod args;
#[cfg(feature = "mongodb")]
mod processes;

use clap::{Args, Subcommand};

use super::Context;
#[cfg(not(feature = "mongodb"))]
use super::UsageError;
use crate::error::Result;
use crate::exit::Exit;
use args::{DownArgs, StatusArgs, UpArgs};

/// What stands below the help of `backend`.
const HELP: &str = "\
Examples:
  rmem backend up
  rmem backend status --format table
  rmem backend down shared";

/// Start, inspect and stop the mongod processes of this robot
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct BackendArgs {
    /// What to do with them.
    #[command(subcommand)]
    pub command: BackendCommand,
}

/// The commands of `backend`.
#[derive(Debug, Subcommand)]
pub enum BackendCommand {
    Up(UpArgs),
    Status(StatusArgs),
    Down(DownArgs),
}

#[cfg(feature = "mongodb")]
pub(super) fn run(args: &BackendArgs, context: &mut Context<'_>) -> Result<Exit> {
    match &args.command {
        BackendCommand::Up(args) => processes::up(args, context),
        BackendCommand::Status(_) => processes::status(context),
        BackendCommand::Down(args) => processes::down(args, context),
    }
}

#[cfg(not(feature = "mongodb"))]
pub(super) fn run(_: &BackendArgs, _: &mut Context<'_>) -> Result<Exit> {
    let text = "this rmem was built without MongoDB; build it with `--features mongodb`";
    Err(UsageError::new(text).into())
}
