//! The command line: what holds for every command, and the help of the whole.
//!
//! A command's own arguments are beside its body, in [`crate::commands`]. How a flag is
//! layered over the environment and `rmem.toml` is decided in [`crate::settings`].

use std::path::PathBuf;

use clap::{Args, CommandFactory as _, Parser};

use crate::commands::Command;
use crate::output::Format;
use crate::settings::{Color, Flags};

/// A document-oriented robot memory: PDDL problems from queries, plans back into the memory
#[derive(Debug, Parser)]
#[command(name = "rmem", version, propagate_version = true, max_term_width = 100, disable_help_subcommand = false)]
#[command(after_help = "Exit codes: rmem help exit-codes")]
pub struct Cli {
    /// What holds for every command.
    #[command(flatten)]
    pub global: Global,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// Returns the description of the command line.
#[must_use]
pub fn command() -> clap::Command {
    Cli::command()
}

/// What holds for every command.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Global options")]
pub struct Global {
    /// The local store: file:PATH, mem:, or mongodb://… [env: RMEM_MEMORY]
    #[arg(long, global = true, value_name = "URI")]
    pub memory: Option<String>,
    /// The store of shared databases [env: RMEM_SHARED]
    #[arg(long, global = true, value_name = "URI")]
    pub shared: Option<String>,
    /// Settings; else the nearest rmem.toml upwards, then the user's [env: RMEM_CONFIG]
    #[arg(long, global = true, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Put a world file into the memory before the command runs (can be repeated)
    #[arg(long, global = true, value_name = "WORLD")]
    pub load: Vec<PathBuf>,
    /// How results are printed [env: RMEM_FORMAT]
    #[arg(long, global = true, value_name = "FORMAT", hide_possible_values = true)]
    pub format: Option<Format>,
    /// The namespace where none is given [env: RMEM_COLLECTION]
    #[arg(long, global = true, value_name = "NS")]
    pub collection: Option<String>,
    /// Say nothing but errors
    #[arg(short, long, global = true, conflicts_with = "verbose", overrides_with = "quiet")]
    pub quiet: bool,
    /// Say each operation and how long it took
    #[arg(short, long, global = true, overrides_with = "verbose")]
    pub verbose: bool,
    /// Colour messages: auto, always, never [env: NO_COLOR]
    #[arg(long, global = true, value_name = "WHEN", hide_possible_values = true)]
    pub color: Option<Color>,
    /// Append each operation to FILE as JSON lines [env: RMEM_LOG]
    #[arg(long, global = true, value_name = "FILE")]
    pub log: Option<PathBuf>,
}

impl From<Global> for Flags {
    fn from(global: Global) -> Self {
        Self {
            memory: global.memory,
            shared: global.shared,
            config: global.config,
            load: global.load,
            format: global.format,
            collection: global.collection,
            quiet: global.quiet,
            verbose: global.verbose,
            color: global.color,
            log: global.log,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn every_command_has_an_example() {
        fn check(command: &clap::Command) {
            let help = command.clone().render_long_help().to_string();
            assert!(help.contains("Example"), "{} has no example", command.get_name());
            command.get_subcommands().filter(|inner| inner.get_name() != "help").for_each(check);
        }
        command().get_subcommands().for_each(check);
    }
}
