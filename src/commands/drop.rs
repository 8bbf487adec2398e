//! `rmem drop NS`, `rmem drop --database NAME`: remove a whole collection, or all of a database.

use bson::doc;
use clap::Args;

use super::{Context, UsageError, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::output::amount;
use crate::store::Namespace;

/// What stands below the help of `drop`.
const HELP: &str = "\
Examples:
  rmem drop robmem.worldmodel
  rmem drop --database robmem

With --database, everything that rmem keeps for the database goes with it: what is in the cache of computables, the \
positions of watches.";

/// Remove a collection with all its documents and indexes
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::TEXT))]
pub struct DropArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS", required_unless_present = "database")]
    pub namespace: Option<Namespace>,
    /// Remove all collections of a database
    #[arg(long, value_name = "NAME", conflicts_with = "namespace")]
    pub database: Option<String>,
}

pub(super) fn run(args: &DropArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::TEXT)?;
    if let Some(namespace) = &args.namespace {
        let is_dropped = context.memory()?.drop_collection(namespace)?;
        context.print_report([], doc! { "ns": namespace.to_string(), "dropped": is_dropped })?;
        if !is_dropped {
            context.output.warn(&format!("there is no collection {namespace}"));
        }
    }
    if let Some(database) = &args.database {
        let is_name = format!("{database}.x").parse::<Namespace>().is_ok_and(|ns| ns.database == *database);
        if !is_name {
            return Err(UsageError::new(format!("`{database}` is not the name of a database, like robmem")).into());
        }
        let dropped = context.memory()?.drop_database(database)?;
        let names: Vec<String> = dropped.iter().map(ToString::to_string).collect();
        context.print_report([], doc! { "database": database, "dropped": &names })?;
        match names.is_empty() {
            true => context.output.warn(&format!("there is no database {database}")),
            false => {
                let count = amount(names.len() as u64, "collection");
                context.output.note(&format!("{count} removed: {}", names.join(", ")));
            }
        }
    }
    Ok(Exit::Done)
}
