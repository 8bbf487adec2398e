//! One file per subcommand; here the dispatch, and what they share.

mod aggregate;
mod backend;
mod bench;
mod clips;
mod collections;
mod completions;
mod computables;
mod config;
mod count;
mod delete;
mod diff;
mod distinct;
mod doctor;
mod drop;
mod dump;
mod exit_codes;
mod expire;
mod explanation;
mod ff;
mod gen_problem;
mod import_problem;
mod index;
mod insert;
mod lock;
mod man;
mod plan;
mod query;
mod restore;
mod unlock;
mod update;
mod validate;
mod watch;

pub mod context;

pub use context::Context;

pub(crate) use crate::input::{UsageError, WrongInput};

use crate::cli::Command;
use crate::exit::Exit;

/// Runs one command.
///
/// # Errors
/// What went wrong; [`Exit::of`] gives it a code.
pub fn run(command: &Command, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    match command {
        Command::Aggregate(args) => aggregate::run(args, context),
        Command::Backend(args) => backend::run(args, context),
        Command::Bench(args) => bench::run(args, context),
        Command::Clips(args) => clips::run(args, context),
        Command::Collections => collections::run(context),
        Command::Computables(args) => computables::run(args, context),
        Command::Completions(args) => completions::run(args, context),
        Command::Config => config::run(context),
        Command::Count(args) => count::run(args, context),
        Command::Delete(args) => delete::run(args, context),
        Command::Diff(args) => diff::run(args, context),
        Command::Distinct(args) => distinct::run(args, context),
        Command::Doctor => doctor::run(context),
        Command::Drop(args) => drop::run(args, context),
        Command::Dump(args) => dump::run(args, context),
        Command::ExitCodes => exit_codes::run(context),
        Command::Expire(args) => expire::run(args, context),
        Command::Ff(args) => ff::run(args, context),
        Command::GenProblem(args) => gen_problem::run(args, context),
        Command::ImportProblem(args) => import_problem::run(args, context),
        Command::Index(args) => index::run(args, context),
        Command::Insert(args) => insert::run(args, context),
        Command::Lock(args) => lock::run(args, context),
        Command::Man => man::run(context),
        Command::Plan(args) => plan::run(args, context),
        Command::Query(args) => query::run(args, context),
        Command::Restore(args) => restore::run(args, context),
        Command::Unlock(args) => unlock::run(args, context),
        Command::Update(args) => update::run(args, context),
        Command::Validate(args) => validate::run(args, context),
        Command::Watch(args) => watch::run(args, context),
    }
}
