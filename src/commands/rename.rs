//! `rmem rename FROM TO`: give a collection another name.

use bson::doc;
use clap::Args;

use super::{Context, UsageError, WrongInput, formats, missing};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::query::QueryError;
use crate::store::{Namespace, StoreError};

/// What stands below the help of `rename`.
const HELP: &str = "\
Examples:
  rmem rename robmem.objects robmem.things
  rmem rename robmem.next robmem.plans --drop-target

The indexes and the collation go with the collection. Both names are of one database: 'rmem dump' and \
'rmem restore --into' bring documents into another one.";

/// Give a collection another name
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::TEXT))]
pub struct RenameArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "FROM")]
    pub from: Namespace,
    /// Its new name, in the same database
    #[arg(value_name = "TO")]
    pub to: Namespace,
    /// Replace the collection that has the new name
    #[arg(long)]
    pub drop_target: bool,
}

pub(super) fn run(args: &RenameArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::TEXT)?;
    let RenameArgs { from, to, drop_target } = args;
    if from.database != to.database {
        let message = format!(
            "{from} and {to} are of two databases; write: rmem dump {from} -o FILE.json, then rmem restore FILE.json --into {to}"
        );
        return Err(UsageError::new(message).into());
    }
    if from == to {
        return Err(UsageError::new(format!("{from} has that name already")).into());
    }
    let memory = context.memory()?;
    if !memory.collections_beside(from)?.contains(from) {
        let message = missing::message(from, &memory, context).unwrap_or_else(|| format!("no collection {from}"));
        return Err(WrongInput::new(message).into());
    }
    memory.rename_collection(from, to, *drop_target).map_err(|error| match error {
        StoreError::Query(refusal) if refusal.code == QueryError::NAMESPACE_EXISTS => {
            let message = format!("{to} exists already; --drop-target replaces it, with all its documents");
            WrongInput::new(message).into()
        }
        error => Error::from(error),
    })?;
    context.print_report([], doc! { "ns": from.to_string(), "renamed": to.to_string() })?;
    Ok(Exit::Done)
}
