//! One file per subcommand: its arguments, whose documentation is its help, and its body. Here is the list.

mod aggregate;
mod at;
mod backend;
mod backup;
mod bench;
mod clips;
mod coll_mod;
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
mod read;
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
mod texts;
mod undo;
mod unlock;
mod update;
mod validate;
mod validation;
#[cfg(feature = "views")]
mod view;
mod watch;

pub mod context;

pub use context::Context;
pub(crate) use error::report;

pub(crate) use crate::input::{UsageError, WrongInput};

use std::ffi::OsString;

use clap::{Args as _, Subcommand};

use crate::error::Result;
use crate::exit::Exit;

/// Lists the commands: an enum of their arguments, which of them a command line may mean, and what runs each.
macro_rules! commands {
    ($($(#[$attribute:meta])* $name:literal $variant:ident($module:ident::$args:ident),)*) => {
        /// The commands, in the order of the help.
        #[derive(Debug, Subcommand)]
        #[expect(missing_docs, reason = "a variant's documentation would replace the help of its arguments")]
        pub enum Command {
            $($(#[$attribute])* #[command(name = $name)] $variant($module::$args),)*
        }

        /// Adds the commands whose names are among these words. The arguments of all commands take longer to describe than a
        /// line takes to parse.
        pub(crate) fn add_named(mut command: clap::Command, words: &[OsString]) -> clap::Command {
            $($(#[$attribute])* if words.iter().any(|word| word == $name) {
                command = command.subcommand($module::$args::augment_args(clap::Command::new($name)));
            })*
            command
        }

        /// Runs one command.
        ///
        /// # Errors
        /// What went wrong; [`report`] prints it and gives it a code.
        pub fn run(command: &mut Command, context: &mut Context<'_>) -> Result<Exit> {
            texts::read(texts_of(command), context)?;
            match &*command {
                $($(#[$attribute])* Command::$variant(args) => $module::run(args, context),)*
            }
        }
    };
}

commands! {
    "insert" Insert(insert::InsertArgs),
    "query" Query(query::QueryArgs),
    "count" Count(count::CountArgs),
    "distinct" Distinct(distinct::DistinctArgs),
    "aggregate" Aggregate(aggregate::AggregateArgs),
    "map-reduce" MapReduce(map_reduce::MapReduceArgs),
    "update" Update(update::UpdateArgs),
    "find-and-modify" FindAndModify(find_and_modify::FindAndModifyArgs),
    "delete" Delete(delete::DeleteArgs),
    "index" Index(index::IndexArgs),
    "collections" Collections(collections::CollectionsArgs),
    "create" Create(create::CreateArgs),
    "coll-mod" CollMod(coll_mod::CollModArgs),
    "rename" Rename(rename::RenameArgs),
    "drop" Drop(drop::DropArgs),
    "history" History(history::HistoryArgs),
    "undo" Undo(undo::UndoArgs),
    "record" Record(record::RecordArgs),
    "dump" Dump(dump::DumpArgs),
    "restore" Restore(restore::RestoreArgs),
    "backup" Backup(backup::BackupArgs),
    "repair" Repair(repair::RepairArgs),
    "diff" Diff(diff::DiffArgs),
    "lock" Lock(lock::LockArgs),
    "unlock" Unlock(unlock::UnlockArgs),
    "watch" Watch(watch::WatchArgs),
    #[cfg(feature = "serve")]
    "serve" Serve(serve::ServeArgs),
    "backend" Backend(backend::BackendArgs),
    "computables" Computables(computables::ComputablesArgs),
    "gen-problem" GenProblem(gen_problem::GenProblemArgs),
    "import-problem" ImportProblem(import_problem::ImportProblemArgs),
    "plan" Plan(plan::PlanArgs),
    "compare" Compare(compare::CompareArgs),
    "ff" Ff(ff::FfArgs),
    "validate" Validate(validate::ValidateArgs),
    "clips" Clips(clips::ClipsArgs),
    "scene" Scene(scene::SceneArgs),
    "schema" Schema(schema::SchemaArgs),
    "plot" Plot(plot::PlotArgs),
    #[cfg(feature = "views")]
    "export" Export(export::ExportArgs),
    #[cfg(feature = "views")]
    "view" View(view::ViewArgs),
    "expire" Expire(expire::ExpireArgs),
    "bench" Bench(bench::BenchArgs),
    "init" Init(init::InitArgs),
    "config" Config(config::ConfigArgs),
    "doctor" Doctor(doctor::DoctorArgs),
    "completions" Completions(completions::CompletionsArgs),
    "man" Man(man::ManArgs),
    "exit-codes" ExitCodes(exit_codes::ExitCodesArgs),
}

/// The queries, updates and pipelines of a command line, which may be `-`.
fn texts_of(command: &mut Command) -> Vec<&mut String> {
    match command {
        Command::Query(args) => vec![&mut args.query],
        Command::Count(args) => vec![&mut args.query],
        Command::Distinct(args) => vec![&mut args.query],
        Command::Aggregate(args) => vec![&mut args.pipeline],
        Command::MapReduce(args) => vec![&mut args.query],
        Command::Update(args) => vec![&mut args.query, &mut args.update],
        Command::FindAndModify(args) => std::iter::once(&mut args.query).chain(&mut args.update).collect(),
        Command::Delete(args) => vec![&mut args.query],
        Command::History(args) => vec![&mut args.changes.query],
        Command::Undo(args) => vec![&mut args.changes.query],
        Command::Watch(args) => vec![&mut args.query],
        Command::Clips(args) => match &mut args.command {
            clips::ClipsCommand::Export(args) => args.query.iter_mut().collect(),
            _ => Vec::new(),
        },
        Command::Scene(args) => args.command.query().into_iter().collect(),
        Command::Schema(args) => vec![&mut args.query],
        Command::Plot(args) => vec![&mut args.pipeline],
        #[cfg(feature = "views")]
        Command::Export(args) => match &mut args.command {
            export::ExportCommand::Mcap(args) => vec![&mut args.query],
        },
        _ => Vec::new(),
    }
}
