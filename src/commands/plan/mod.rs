//! `rmem plan`: finding plans, and what is done with those that are stored; one file per command.

mod check;
mod import;
mod list;
mod rerun;
mod search;
mod show;
mod source;
mod step;
mod stored;
mod watch;
mod why;

#[cfg(feature = "clips-engine")]
pub(super) use search::registry;

use super::Context;
use crate::cli::{Plan, PlanCommand};
use crate::exit::Exit;

pub(super) fn run(args: &Plan, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    match args {
        Plan::Search(search) => search::run(search, context),
        Plan::Stored(PlanCommand::Check(args)) => check::run(args, context),
        Plan::Stored(PlanCommand::Import(args)) => import::run(args, context),
        Plan::Stored(PlanCommand::List(args)) => list::run(args, context),
        Plan::Stored(PlanCommand::Rerun(args)) => rerun::run(args, context),
        Plan::Stored(PlanCommand::Show(args)) => show::run(args, context),
        Plan::Stored(PlanCommand::Step(args)) => step::run(args, context),
        Plan::Stored(PlanCommand::Why(args)) => why::run(args, context),
    }
}
