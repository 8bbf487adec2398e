//! `rmem plan`: finding plans, and what is done with those that are stored; one file per command.

mod check;
mod find;
mod import;
mod layout;
mod list;
mod rerun;
mod search;
mod show;
mod source;
mod step;
mod stored;
mod watch;
mod why;

use clap::error::ErrorKind;
use clap::{ArgMatches, Args, Command, Error, FromArgMatches, Subcommand};

use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use search::SearchArgs;

/// The first line of the help of `plan`.
const ABOUT: &str = "Find a plan, validate it, store it and print it";

/// What stands below the help of `plan`.
const HELP: &str = "\
Examples:
  rmem plan --domain domain.pddl --template problem.pddl.j2 --goal '(on A B)'
  rmem gen-problem --template problem.pddl.j2 | rmem plan --domain domain.pddl --problem -
  rmem plan --domain domain.pddl --template problem.pddl.j2 --watch

With --watch, rmem prints a plan and stays. \
When a collection changes that the template queries, or that pipelines of its computables read, or a step of the plan is marked as done or failed, the remaining steps are simulated from the memory as it is then. \
A plan that holds is kept; any other is replaced by a new one, stored and printed. \
Where no problem can be made of the memory for a while, as where a document lacks a key, rmem says so once and waits for the next change; at the start, that is an error. \
A step that is marked as started (plan step ID N --started) counts as begun: the check asks only for what it needs after its start. \
An interruption ends the watch.";

/// The arguments of `plan`: those of a search, or a command about stored plans.
#[derive(Debug)]
pub enum PlanArgs {
    /// Find a plan.
    Search(Box<SearchArgs>),
    /// Do something with plans that are stored.
    Stored(PlanCommand),
}

// Written by hand, because a derived enum would need a subcommand for the search.
impl Args for PlanArgs {
    fn augment_args(command: Command) -> Command {
        let command = SearchArgs::augment_args(command).after_help(HELP).arg(formats::argument(&formats::PLAN));
        PlanCommand::augment_subcommands(command).subcommand_negates_reqs(true).about(ABOUT)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for PlanArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        if matches.subcommand_name().is_none() {
            return SearchArgs::from_arg_matches(matches).map(|search| Self::Search(Box::new(search)));
        }
        if matches.contains_id("domain") || matches.contains_id("problem") || matches.contains_id("template") {
            let message =
                "--domain, --problem and --template are given without a subcommand: rmem plan --domain FILE …\n";
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
    Check(check::CheckArgs),
    Step(step::StepArgs),
    Show(show::ShowArgs),
    Why(why::WhyArgs),
    List(list::ListArgs),
    Import(Box<import::ImportArgs>),
    Rerun(rerun::RerunArgs),
}

pub(super) fn run(args: &PlanArgs, context: &mut Context<'_>) -> Result<Exit> {
    match args {
        PlanArgs::Search(search) => search::run(search, context),
        PlanArgs::Stored(PlanCommand::Check(args)) => check::run(args, context),
        PlanArgs::Stored(PlanCommand::Import(args)) => import::run(args, context),
        PlanArgs::Stored(PlanCommand::List(args)) => list::run(args, context),
        PlanArgs::Stored(PlanCommand::Rerun(args)) => rerun::run(args, context),
        PlanArgs::Stored(PlanCommand::Show(args)) => show::run(args, context),
        PlanArgs::Stored(PlanCommand::Step(args)) => step::run(args, context),
        PlanArgs::Stored(PlanCommand::Why(args)) => why::run(args, context),
    }
}
