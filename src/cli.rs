//! The command line: what holds for every command, and the help of the whole.
//!
//! A command's own arguments are beside its body, in [`crate::commands`]. How a flag is
//! layered over the environment and `rmem.toml` is decided in [`crate::settings`].

mod import_problem;
mod plan;

use std::path::PathBuf;

use clap::{Args, CommandFactory as _, Parser, ValueEnum};

use crate::commands::Command;
use crate::output::Format;
use crate::settings::{Color, Flags};

pub use import_problem::{HELP as IMPORT_PROBLEM_HELP, ImportProblem};
pub use plan::{
    Layout, Plan, PlanCheck, PlanCommand, PlanEffort, PlanImport, PlanList, PlanRerun, PlanSearch, PlanShow, PlanState,
    PlanStep, PlanTask,
};

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

/// What a template needs; shared by `gen-problem` and `plan`.
#[derive(Debug, Clone, Default, Args)]
pub struct TemplateOptions {
    /// The problem's goal, as PDDL
    #[arg(long, value_name = "GOAL", allow_hyphen_values = true)]
    pub goal: Option<String>,
    /// A parameter: NAME=TEXT, or NAME:=JSON for other types (can be repeated)
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE", value_parser = definition)]
    pub definitions: Vec<Definition>,
    /// How the template is spelled: auto, minijinja, marker
    #[arg(long, value_name = "SYNTAX", default_value = "auto", hide_possible_values = true)]
    pub syntax: TemplateSyntax,
    /// Take what is wrong as the Fawkes original did: unknown keys are empty
    #[arg(long)]
    pub lenient: bool,
    /// A section that matches no document is an error
    #[arg(long)]
    pub strict: bool,
}

/// How a template is spelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum TemplateSyntax {
    /// By its content.
    #[default]
    Auto,
    /// `{{ … }}`, `{% … %}`
    Minijinja,
    /// `<<#NAME|{query}>> … <</NAME>>`
    Marker,
}

/// `-D NAME=TEXT` or `-D NAME:=JSON`
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Definition {
    /// The parameter.
    pub name: String,
    /// Its value, as it was written.
    pub value: String,
    /// Whether the value is typed (`:=`).
    pub typed: bool,
}

fn definition(text: &str) -> Result<Definition, String> {
    let Some((name, value)) = text.split_once('=') else {
        return Err("expected NAME=TEXT or NAME:=JSON".to_owned());
    };
    let (name, typed) = name.strip_suffix(':').map_or((name, false), |name| (name, true));
    let legal = |c: char| c.is_ascii_alphanumeric() || c == '_';
    if name.is_empty() || !name.chars().all(legal) || name.starts_with(|c: char| c.is_ascii_digit()) {
        return Err(format!("`{name}` is not a parameter's name; expected letters, digits and _"));
    }
    Ok(Definition { name: name.to_owned(), value: value.to_owned(), typed })
}

/// `gen-problem`
#[derive(Debug, Args)]
pub struct GenProblem {
    /// The template; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub template: PathBuf,
    /// Check the problem against this domain
    #[arg(short, long, value_name = "FILE")]
    pub domain: Option<PathBuf>,
    /// What the template is given.
    #[command(flatten)]
    pub options: TemplateOptions,
    /// The problem file to write, whole or not at all
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    pub output: PathBuf,
    /// Instead of the problem, tell what is behind an atom like '(on A B)', a number, or an object
    #[arg(long, value_name = "ATOM", conflicts_with = "output")]
    pub explain: Option<String>,
}

/// `ff`
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
pub struct Ff {
    /// The domain (FF's operator file)
    #[arg(short = 'o', value_name = "DOMAIN")]
    pub domain: PathBuf,
    /// The problem (FF's fact file)
    #[arg(short = 'f', value_name = "PROBLEM")]
    pub problem: PathBuf,
    /// What both names of files begin with, like a folder and its `/`
    #[arg(short = 'p', value_name = "PATH")]
    pub path: Option<PathBuf>,
    /// FF's level of information; ignored
    #[arg(short = 'i', value_name = "N")]
    pub information: Option<String>,
    /// FF's search; ignored, the built-in planner has its own
    #[arg(short = 's', value_name = "N")]
    pub search: Option<String>,
    /// FF's weight of the cost so far; ignored
    #[arg(short = 'g', value_name = "N")]
    pub so_far: Option<String>,
    /// FF's weight of the estimate; ignored
    #[arg(short = 'h', value_name = "N")]
    pub estimate: Option<String>,
    /// FF's weight of the search; ignored
    #[arg(short = 'w', value_name = "N")]
    pub weight: Option<String>,
    /// FF's seed or restarts; ignored
    #[arg(short = 'r', value_name = "N")]
    pub restarts: Option<String>,
    /// FF's switch of enforced hill-climbing; ignored
    #[arg(short = 'E')]
    pub climbing: bool,
    /// FF's switch of its optimization criterion; ignored
    #[arg(short = 'O')]
    pub criterion: bool,
    /// FF's switch of cost minimization; ignored
    #[arg(short = 'C')]
    pub costs: bool,
    /// Print the first plan at once and every better one after it, for as long as there may be one
    #[arg(long)]
    pub anytime: bool,
    /// The files are a task that rmem has checked and written
    #[arg(long, hide = true)]
    pub checked: bool,
    /// Print help
    #[arg(long, action = clap::ArgAction::HelpLong)]
    pub help: Option<bool>,
}

/// `validate`
#[derive(Debug, Args)]
pub struct Validate {
    /// The domain
    #[arg(value_name = "DOMAIN")]
    pub domain: PathBuf,
    /// A problem of it; - is stdin
    #[arg(value_name = "PROBLEM")]
    pub problem: Option<PathBuf>,
    /// A plan for it; - is stdin
    #[arg(value_name = "PLAN")]
    pub plan: Option<PathBuf>,
    /// Take `//` to the end of a line as a comment
    #[arg(long)]
    pub lenient: bool,
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

    #[test]
    fn definitions_are_text_or_typed() {
        assert_eq!(
            definition("robot=R2=D2"),
            Ok(Definition { name: "robot".into(), value: "R2=D2".into(), typed: false })
        );
        assert!(definition("n:=3").unwrap().typed);
        for text in ["", "x", "=1", "1x=2", "a b=3", "a-b=1"] {
            assert!(definition(text).is_err(), "{text}");
        }
    }
}
