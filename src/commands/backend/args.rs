//! The arguments of `rmem backend up|status|down`.

use std::time::Duration;

use clap::{Args, ValueEnum};

use crate::commands::formats;
use crate::formats::quantity;

/// What stands below the help of `backend up`.
const UP_HELP: &str = "\
Examples:
  rmem backend up
  rmem backend up shared --wait 1m

Starts the mongod processes of [backend.local] and [backend.shared] in rmem.toml in the background; log and pid file \
are beside the data. A process that runs already is left as it is, so the command can be repeated at any time.

The first robot that reaches a majority of the members initiates the replica set; members that were added to the \
settings are added to the set. While a majority is missing, a warning names the missing members. With --wait, the \
command waits for them, and exits with 1 if they do not come.

The servers require no password; run them in the robots' own network only.";

/// Start the mongod processes that do not run, and initiate or join their replica sets
#[derive(Debug, Args)]
#[command(after_help = UP_HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct UpArgs {
    /// local or shared (default: both)
    #[arg(value_name = "BACKEND", hide_possible_values = true)]
    pub backends: Vec<BackendName>,
    /// Wait at most this long until every replica set accepts writes
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub wait: Option<Duration>,
}

/// What stands below the help of `backend status`.
const STATUS_HELP: &str = "\
Examples:
  rmem backend status
  rmem backend status --format table

lag_seconds is how far a member is behind the primary; oplog_seconds is how long it can be away and still catch up \
from that member's log. Exits with 1 if a member is not up.";

/// Print the state, lag, operations log and version of each member
#[derive(Debug, Args)]
#[command(after_help = STATUS_HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct StatusArgs {}

/// What stands below the help of `backend down`.
const DOWN_HELP: &str = "\
Examples:
  rmem backend down
  rmem backend down local

Exits with 1 if a mongod runs that rmem backend up did not start; that one is not stopped.";

/// Stop the mongod processes that `rmem backend up` started
#[derive(Debug, Args)]
#[command(after_help = DOWN_HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct DownArgs {
    /// local or shared (default: both)
    #[arg(value_name = "BACKEND", hide_possible_values = true)]
    pub backends: Vec<BackendName>,
}

/// A table of `rmem.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BackendName {
    /// `[backend.local]`
    Local,
    /// `[backend.shared]`
    Shared,
}

impl BackendName {
    /// The name of the table.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Local => "local",
            Self::Shared => "shared",
        }
    }
}
