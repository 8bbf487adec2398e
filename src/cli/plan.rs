//! `plan`: finding plans, and what is done with those that are stored.

use std::path::PathBuf;
use std::time::Duration;

use clap::error::ErrorKind;
use clap::{ArgMatches, Args, Command, Error, FromArgMatches, Subcommand, ValueEnum};

use super::{TemplateOptions, quantity};
use crate::store::Namespace;

/// `plan`: a search, or a command about stored plans.
#[derive(Debug)]
pub enum Plan {
    /// Find a plan.
    Search(Box<PlanSearch>),
    /// Do something with plans that are stored.
    Stored(PlanCommand),
}

// By hand, because a derived enum would need a word in front of the search.
impl Args for Plan {
    fn augment_args(command: Command) -> Command {
        PlanCommand::augment_subcommands(PlanSearch::augment_args(command)).subcommand_negates_reqs(true)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Plan {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        if matches.subcommand_name().is_none() {
            return PlanSearch::from_arg_matches(matches).map(|search| Self::Search(Box::new(search)));
        }
        if matches.contains_id("domain") || matches.contains_id("problem") || matches.contains_id("template") {
            let message = "what is to be planned is said without a command: rmem plan --domain FILE …\n";
            return Err(Error::raw(ErrorKind::ArgumentConflict, message));
        }
        PlanCommand::from_arg_matches(matches).map(Self::Stored)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The commands about stored plans.
#[derive(Debug, Subcommand)]
pub enum PlanCommand {
    /// List the stored plans, the newest first
    #[command(after_help = "Example:\n  rmem plan list --limit 5")]
    List(PlanList),
}

/// `plan list`
#[derive(Debug, Args)]
pub struct PlanList {
    /// Where the plans are
    #[arg(long = "in", value_name = "NS", default_value = "robmem.plans")]
    pub namespace: Namespace,
    /// At most so many; 0 is all
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub limit: u64,
}

/// What is planned, and how.
#[derive(Debug, Clone, Args)]
pub struct PlanSearch {
    /// The domain
    #[arg(short, long, value_name = "FILE")]
    pub domain: PathBuf,
    /// A problem; - is stdin
    #[arg(short, long, value_name = "FILE", required_unless_present = "template", conflicts_with = "template")]
    pub problem: Option<PathBuf>,
    /// A template to generate the problem from; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub template: Option<PathBuf>,
    /// What the template is given.
    #[command(flatten)]
    pub options: TemplateOptions,
    /// builtin, ff, fast-downward, or a [planner.NAME] of rmem.toml; several race each other
    #[arg(long, value_name = "NAME", default_value = "builtin")]
    pub planner: Vec<String>,
    /// How long the planner may run
    #[arg(long, value_name = "DURATION", default_value = "60s", value_parser = quantity::duration)]
    pub timeout: Duration,
    /// Use all of that time for better plans, and take the best
    #[arg(long)]
    pub anytime: bool,
    /// How much memory the planner may use
    #[arg(long, value_name = "SIZE", value_parser = quantity::size)]
    pub memory_limit: Option<u64>,
    /// Where the plan is stored
    #[arg(long, value_name = "NS", default_value = "robmem.plans")]
    pub into: Namespace,
    /// How the plan document is laid out: numbered, fawkes
    #[arg(long, value_name = "LAYOUT", default_value = "numbered", hide_possible_values = true)]
    pub layout: Layout,
    /// Do not store the plan
    #[arg(long)]
    pub no_store: bool,
}

/// The layouts of a plan document.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Layout {
    /// One numbered key a step.
    #[default]
    Numbered,
    /// An array of actions, as Fawkes stores them.
    Fawkes,
}
