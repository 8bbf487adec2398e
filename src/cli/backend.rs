//! `backend`: the mongod processes of this robot.

use std::time::Duration;

use clap::{Args, Subcommand, ValueEnum};

use super::quantity;

/// `backend`
#[derive(Debug, Args)]
pub struct Backend {
    /// What to do with them.
    #[command(subcommand)]
    pub command: BackendCommand,
}

/// The commands of `backend`.
#[derive(Debug, Subcommand)]
pub enum BackendCommand {
    /// Start what is missing, with replica sets founded and joined
    #[command(after_help = "Examples:\n  rmem backend up\n  rmem backend up shared --wait 1m\n\n\
Starts the mongod of [backend.local] and [backend.shared] in rmem.toml, in the background, with\n\
its log and pid file beside its data. A replica set is founded once a majority of its members\n\
answers, by whichever robot is there; members that were added to the settings are added to\n\
the set. What is running stays as it is, so that the command can be given again at any time.\n\
Where a majority of the members does not answer yet, this robot's part is done and a warning\n\
says who is missing; with --wait, that is waited for, and its absence exits with 1.\n\
The servers ask nobody for a password: they belong into the robots' own network.")]
    Up(BackendUp),
    /// Print each member with its state, lag, operations log and version
    #[command(after_help = "Examples:\n  rmem backend status\n  rmem backend status --format table\n\n\
lag_seconds is how far a member is behind the primary, oplog_seconds how long it can be away\n\
and still catch up from that member's log. Exits with 1 where a member is not up.")]
    Status,
    /// Stop what `rmem backend up` started
    #[command(after_help = "Examples:\n  rmem backend down\n  rmem backend down local\n\n\
A mongod that something else started is left alone, which exits with 1.")]
    Down {
        /// Which of them; all where none is named
        #[arg(value_name = "BACKEND", hide_possible_values = true)]
        backends: Vec<BackendName>,
    },
}

/// `backend up`
#[derive(Debug, Args)]
pub struct BackendUp {
    /// local or shared; both where none is named
    #[arg(value_name = "BACKEND", hide_possible_values = true)]
    pub backends: Vec<BackendName>,
    /// Wait until every replica set takes writes; exit with 1 where one does not by then
    #[arg(long, value_name = "D", value_parser = quantity::duration)]
    pub wait: Option<Duration>,
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
