//! `rmem delete NS QUERY`: remove the documents that match.

use bson::doc;
use clap::Args;

use super::modifiers::ModifierArgs;
use super::query::{blame, filter_of};
use super::{Context, UsageError, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::interrupt::InterruptGuard;
use crate::memory::Memory;
use crate::store::{Find, Namespace, Query, StoreError};

/// What stands below the help of `delete`.
const HELP: &str = "\
Examples:
  rmem delete robmem.worldmodel \"{relation: 'holding'}\"
  rmem delete robmem.worldmodel \"{relation: 'on'}\" --many
  rmem delete robmem.worldmodel --all

Removes the first document that matches, and reports if more match. Prints the number of removed documents.";

/// Remove documents
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::RESULT))]
pub struct DeleteArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Query that selects documents, or - for stdin; an empty one needs --all
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Remove all documents that match (default: the first)
    #[arg(long)]
    pub many: bool,
    /// Remove all documents of the collection
    #[arg(long, conflicts_with = "many")]
    pub all: bool,
    /// How strings compare, variables, and the index to read.
    #[command(flatten)]
    pub modifiers: ModifierArgs,
}

pub(super) fn run(args: &DeleteArgs, context: &mut Context<'_>) -> Result<Exit> {
    let filter = filter_of(&args.namespace, &args.query)?;
    if filter.is_empty() && !args.all {
        let text = format!("an empty query matches every document of {}; expected a query, or --all", args.namespace);
        return Err(UsageError::new(text).into());
    }
    if args.all && !filter.is_empty() {
        return Err(UsageError::new("--all takes no query; expected --many for all documents that match").into());
    }
    let (memory, modifiers) = (context.memory()?, args.modifiers.read()?);
    let query = Query { filter: &filter, modifiers: &modifiers };
    let is_many = args.many || args.all;
    let matching = if is_many { None } else { others(&args.namespace, query, &memory, context)? };
    let guard = (is_many && memory.is_in_file(&args.namespace)).then(InterruptGuard::stopping);
    let deleted = memory.delete(&args.namespace, query, !is_many);
    drop(guard);
    let deleted = deleted.map_err(|error| blame(error, &[("<query>", &args.query), args.modifiers.hint()]))?;
    context.output.line(&deleted.to_string())?;
    match matching {
        Some(count) => context.output.note(&format!("{deleted} of {count} matching documents; use --many for all")),
        None if deleted == 0 => drop(missing::warn(&args.namespace, &memory, context)),
        None => {}
    }
    Ok(Exit::Done)
}

/// Returns how many documents match where it is more than one, for a command that changes the first.
pub(super) fn others(
    namespace: &Namespace,
    query: Query<'_>,
    memory: &Memory,
    context: &Context<'_>,
) -> Result<Option<u64>, StoreError> {
    let is_one = query.filter.get("_id").is_some_and(|id| id.as_document().is_none());
    if is_one || !context.output.shows_notes() {
        return Ok(None);
    }
    let (filter, modifiers) = (query.filter.clone(), query.modifiers.clone());
    let all = Find { filter, projection: doc! { "_id": 1 }, modifiers, ..Find::default() };
    let two = Find { limit: 2, ..all.clone() };
    // A query that is refused is reported where it is executed.
    let first = match memory.stored(namespace, &two).and_then(Iterator::collect::<Result<Vec<_>, _>>) {
        Ok(first) => first,
        // A server that does not answer is waited for once.
        Err(error @ StoreError::Unreachable { .. }) => return Err(error),
        Err(_) => return Ok(None),
    };
    Ok(if first.len() < 2 { None } else { Some(memory.stored(namespace, &all)?.count() as u64) })
}
