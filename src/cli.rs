//! The command line: the options of every command, and the help of the whole.
//!
//! A command's own arguments are beside its body, in [`crate::commands`]. How a flag is
//! layered over the environment and `rmem.toml` is decided in [`crate::settings`].

mod help;
mod tips;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, CommandFactory as _, Error, FromArgMatches as _, Parser};

use crate::commands::{Command, add_named, formats};
use crate::output::Format;
use crate::settings::{Color, Flags};

/// A document-oriented robot memory: PDDL problems from queries, plans back into the memory
#[derive(Debug, Parser)]
#[command(name = "rmem", version, propagate_version = true, max_term_width = 100, disable_help_subcommand = false)]
#[command(after_help = "\
Example:\n  rmem insert robmem.worldmodel \"{relation: 'on-table', object: 'A'}\"\n  rmem query robmem.worldmodel\n\n\
The help of a command: rmem help COMMAND. Exit codes: rmem help exit-codes.")]
pub struct Cli {
    /// The options of every command.
    #[command(flatten)]
    pub global: Global,
    /// The command.
    #[command(subcommand)]
    pub command: Command,
    /// The names of the command and its subcommands, e.g. `plan step`.
    #[arg(skip)]
    pub name: String,
    /// The formats that it has; none where it prints nothing in a format.
    #[arg(skip)]
    pub formats: Vec<String>,
}

/// Returns the description of the command line.
#[must_use]
pub fn command() -> clap::Command {
    help::grouped(help::flowing(with_formats(Cli::command())))
}

/// Parses a command line. `database` gives the one of the default collection, for tips about a line of mongosh.
///
/// # Errors
/// Where it is wrong; also for `--help` and `--version`, with their text.
pub fn parse(args: impl IntoIterator<Item = OsString>, database: impl FnOnce() -> String) -> Result<Cli, Error> {
    let mut args: Vec<OsString> = args.into_iter().collect();
    // clap's own command takes no options.
    if let [_, command, option] = args.as_mut_slice()
        && command == "help"
        && (option == "--help" || option == "-h")
    {
        *option = "help".into();
    }
    let mut plain = with_formats(named(&args));
    let (command, matches) = match plain.try_get_matches_from_mut(&args) {
        Ok(matches) => (plain, matches),
        Err(_) => parse_with_help(&args, database)?,
    };
    let (name, formats) = called(&command, &matches);
    check_format(&name, &formats, &matches)?;
    Ok(Cli { name, formats, ..Cli::from_arg_matches(&matches)? })
}

/// Returns the description of the command line without what only helps show, and with the commands alone that these words
/// name: a line that is right needs no more, and any other is parsed again.
fn named(args: &[OsString]) -> clap::Command {
    let command = clap::Command::new("rmem").version(env!("CARGO_PKG_VERSION")).propagate_version(true);
    let command = add_named(Global::augment_args(command), args);
    command.subcommand_required(true).arg_required_else_help(true)
}

/// Parses a command line that is wrong or asks for help, with all that its message or help needs.
fn parse_with_help(args: &[OsString], database: impl FnOnce() -> String) -> Result<(clap::Command, ArgMatches), Error> {
    let mut command = command();
    match command.try_get_matches_from_mut(args) {
        Ok(matches) => Ok((command, matches)),
        Err(error) if error.use_stderr() => Err(tips::with_tip(error, args, &database())),
        Err(error) => Err(error),
    }
}

/// Returns the names of the command and its subcommands, and the formats that it has.
fn called(mut command: &clap::Command, mut matches: &ArgMatches) -> (String, Vec<String>) {
    let mut words = Vec::new();
    while let Some((name, inner)) = matches.subcommand() {
        words.push(name);
        (command, matches) = (command.find_subcommand(name).unwrap_or(command), inner);
    }
    let own = command.get_arguments().find(|argument| argument.get_id() == formats::ID && !argument.is_hide_set());
    let names = own.map(|own| own.get_possible_values().iter().map(|value| value.get_name().to_owned()).collect());
    (words.join(" "), names.unwrap_or_default())
}

/// Hides `--format` from the help of commands that do not have it.
fn with_formats(command: clap::Command) -> clap::Command {
    command.mut_subcommands(|inner| {
        let inner = with_formats(inner);
        let has_format = inner.get_arguments().any(|argument| argument.get_id() == formats::ID);
        if has_format { inner } else { inner.arg(formats::none()) }
    })
}

/// Refuses a `--format` before the command that the command does not have.
fn check_format(name: &str, allowed: &[String], matches: &ArgMatches) -> Result<(), Error> {
    let is_given = matches.value_source(formats::ID) == Some(ValueSource::CommandLine);
    let Some(format) = matches.get_one::<Format>(formats::ID).filter(|_| is_given) else { return Ok(()) };
    if allowed.iter().any(|name| name == format.name()) {
        return Ok(());
    }
    let expected = if allowed.is_empty() { "it has none".to_owned() } else { format!("it has {}", allowed.join(", ")) };
    let message = format!("`rmem {name}` has no format `{}`; {expected}\n", format.name());
    Err(Error::raw(ErrorKind::InvalidValue, message))
}

/// The options of every command.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Global options")]
pub struct Global {
    /// Local store: file:PATH, mem:, or mongodb://… (default: a file in the user's data directory) [env: RMEM_MEMORY]
    #[arg(long, global = true, value_name = "URI")]
    pub memory: Option<String>,
    /// Store of shared databases (default: same as --memory) [env: RMEM_SHARED]
    #[arg(long, global = true, value_name = "URI")]
    pub shared: Option<String>,
    /// Settings file (default: the nearest rmem.toml upwards, then the user's) [env: RMEM_CONFIG]
    #[arg(long, global = true, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Load a world file into the memory first (can be repeated)
    #[arg(long, global = true, value_name = "WORLD")]
    pub load: Vec<PathBuf>,
    /// Output format; see the help of each command [env: RMEM_FORMAT]
    #[arg(long, global = true, value_name = "FORMAT", hide_possible_values = true, value_parser = formats::any())]
    pub format: Option<Format>,
    /// Default collection (default: robmem.worldmodel) [env: RMEM_COLLECTION]
    #[arg(long, global = true, value_name = "NS")]
    pub collection: Option<String>,
    /// Print errors only
    #[arg(short, long, global = true, conflicts_with = "verbose", overrides_with = "quiet")]
    pub quiet: bool,
    /// Print each operation and its duration
    #[arg(short, long, global = true, overrides_with = "verbose")]
    pub verbose: bool,
    /// Colour messages: auto, always, never (default: auto) [env: NO_COLOR]
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
    fn a_command_alone_takes_what_it_takes_among_all() {
        fn arguments(command: &clap::Command) -> Vec<String> {
            let own = command.get_arguments().map(|argument| format!("{argument:?}"));
            own.chain(command.get_subcommands().flat_map(arguments)).collect()
        }
        let all = with_formats(Cli::command());
        for command in all.get_subcommands() {
            let name = command.get_name();
            let alone = with_formats(named(&["rmem".into(), name.into()]));
            assert_eq!(alone.get_subcommands().map(clap::Command::get_name).collect::<Vec<_>>(), [name]);
            let global =
                |command: &clap::Command| command.get_arguments().map(|a| format!("{a:?}")).collect::<Vec<_>>();
            assert_eq!(global(&alone), global(&all), "{name}");
            assert_eq!(alone.find_subcommand(name).map(arguments), Some(arguments(command)), "{name}");
        }
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
