//! One file per subcommand: its arguments, whose documentation is its help, and its body. Here is the list.

mod aggregate;
mod at;
mod backend;
mod backup;
mod bench;
mod clips;
mod collections;
mod compare;
mod completions;
mod computables;
mod config;
mod conflict;
mod count;
mod create;
mod delete;
mod diff;
mod distinct;
mod doctor;
mod drop;
mod dump;
mod error;
mod exit_codes;
mod expire;
mod explanation;
#[cfg(feature = "views")]
mod export;
mod ff;
mod find_and_modify;
pub(crate) mod formats;
mod gen_problem;
mod history;
mod import_problem;
mod index;
mod init;
mod insert;
mod lock;
mod man;
mod map_reduce;
mod missing;
mod modifiers;
mod plan;
mod plot;
mod print;
mod query;
mod record;
mod rename;
mod repair;
mod restore;
mod scene;
mod schema;
mod separated;
#[cfg(feature = "serve")]
mod serve;
mod table;
mod template;
mod undo;
mod unlock;
mod update;
mod validate;
#[cfg(feature = "views")]
mod view;
mod watch;

pub mod context;

pub use context::Context;
pub(crate) use error::report;

pub(crate) use crate::input::{UsageError, WrongInput};

use clap::Subcommand;

use crate::error::Result;
use crate::exit::Exit;

/// The commands, in the order of the help.
#[derive(Debug, Subcommand)]
#[expect(missing_docs, reason = "a variant's documentation would replace the help of its arguments")]
pub enum Command {
    Insert(insert::InsertArgs),
    Query(query::QueryArgs),
    Count(count::CountArgs),
    Distinct(distinct::DistinctArgs),
    Aggregate(aggregate::AggregateArgs),
    MapReduce(map_reduce::MapReduceArgs),
    Update(update::UpdateArgs),
    FindAndModify(find_and_modify::FindAndModifyArgs),
    Delete(delete::DeleteArgs),
    Index(index::IndexArgs),
    Collections(collections::CollectionsArgs),
    Create(create::CreateArgs),
    Rename(rename::RenameArgs),
    Drop(drop::DropArgs),
    History(history::HistoryArgs),
    Undo(undo::UndoArgs),
    Record(record::RecordArgs),
    Dump(dump::DumpArgs),
    Restore(restore::RestoreArgs),
    Backup(backup::BackupArgs),
    Repair(repair::RepairArgs),
    Diff(diff::DiffArgs),
    Lock(lock::LockArgs),
    Unlock(unlock::UnlockArgs),
    Watch(watch::WatchArgs),
    #[cfg(feature = "serve")]
    Serve(serve::ServeArgs),
    Backend(backend::BackendArgs),
    Computables(computables::ComputablesArgs),
    GenProblem(gen_problem::GenProblemArgs),
    ImportProblem(import_problem::ImportProblemArgs),
    Plan(plan::PlanArgs),
    Compare(compare::CompareArgs),
    Ff(ff::FfArgs),
    Validate(validate::ValidateArgs),
    Clips(clips::ClipsArgs),
    Scene(scene::SceneArgs),
    Schema(schema::SchemaArgs),
    Plot(plot::PlotArgs),
    #[cfg(feature = "views")]
    Export(export::ExportArgs),
    #[cfg(feature = "views")]
    View(view::ViewArgs),
    Expire(expire::ExpireArgs),
    Bench(bench::BenchArgs),
    Init(init::InitArgs),
    Config(config::ConfigArgs),
    Doctor(doctor::DoctorArgs),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
    ExitCodes(exit_codes::ExitCodesArgs),
}

/// Runs one command.
///
/// # Errors
/// What went wrong; [`report`] prints it and gives it a code.
pub fn run(command: &Command, context: &mut Context<'_>) -> Result<Exit> {
    match command {
        Command::Aggregate(args) => aggregate::run(args, context),
        Command::MapReduce(args) => map_reduce::run(args, context),
        Command::Backend(args) => backend::run(args, context),
        Command::Backup(args) => backup::run(args, context),
        Command::Bench(args) => bench::run(args, context),
        Command::Clips(args) => clips::run(args, context),
        Command::Collections(args) => collections::run(args, context),
        Command::Compare(args) => compare::run(args, context),
        Command::Completions(args) => completions::run(args, context),
        Command::Computables(args) => computables::run(args, context),
        Command::Config(args) => config::run(args, context),
        Command::Count(args) => count::run(args, context),
        Command::Create(args) => create::run(args, context),
        Command::Delete(args) => delete::run(args, context),
        Command::Diff(args) => diff::run(args, context),
        Command::Distinct(args) => distinct::run(args, context),
        Command::Doctor(args) => doctor::run(args, context),
        Command::Drop(args) => drop::run(args, context),
        Command::Dump(args) => dump::run(args, context),
        Command::ExitCodes(args) => exit_codes::run(args, context),
        Command::Expire(args) => expire::run(args, context),
        #[cfg(feature = "views")]
        Command::Export(args) => export::run(args, context),
        Command::Ff(args) => ff::run(args, context),
        Command::GenProblem(args) => gen_problem::run(args, context),
        Command::History(args) => history::run(args, context),
        Command::ImportProblem(args) => import_problem::run(args, context),
        Command::Index(args) => index::run(args, context),
        Command::Init(args) => init::run(args, context),
        Command::Insert(args) => insert::run(args, context),
        Command::Lock(args) => lock::run(args, context),
        Command::Man(args) => man::run(args, context),
        Command::Plan(args) => plan::run(args, context),
        Command::Query(args) => query::run(args, context),
        Command::Record(args) => record::run(args, context),
        Command::Rename(args) => rename::run(args, context),
        Command::Repair(args) => repair::run(args, context),
        Command::Restore(args) => restore::run(args, context),
        Command::Plot(args) => plot::run(args, context),
        Command::Scene(args) => scene::run(args, context),
        Command::Schema(args) => schema::run(args, context),
        #[cfg(feature = "serve")]
        Command::Serve(args) => serve::run(args, context),
        Command::Undo(args) => undo::run(args, context),
        Command::Unlock(args) => unlock::run(args, context),
        Command::Update(args) => update::run(args, context),
        Command::FindAndModify(args) => find_and_modify::run(args, context),
        Command::Validate(args) => validate::run(args, context),
        #[cfg(feature = "views")]
        Command::View(args) => view::run(args, context),
        Command::Watch(args) => watch::run(args, context),
    }
}
