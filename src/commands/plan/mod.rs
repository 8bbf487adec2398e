//! `rmem plan`: finding plans, and what is done with those that are stored; one file per command.

mod list;
mod run;

use super::Context;
use crate::cli::{Plan, PlanCommand};
use crate::exit::Exit;

pub(super) fn run(args: &Plan, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    match args {
        Plan::Search(search) => run::run(search, context),
        Plan::Stored(PlanCommand::List(args)) => list::run(args, context),
    }
}
