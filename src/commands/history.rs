//! `rmem history NS [QUERY]`: what changed, by which command, and when.

use bson::DateTime;
use clap::Args;

use super::query::{argument, blame};
use super::{Context, at, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::memory::history::{HistoryState, Selection, listed};
use crate::store::Namespace;

/// What stands below the help of `history`.
const HELP: &str = "\
Examples:
  rmem history robmem.worldmodel
  rmem history robmem.worldmodel \"{relation: 'on'}\" --since 10m
  rmem history robmem.worldmodel --by 'rmem plan' --format table

Prints a document for each change, the oldest first: {time, by, operation, ns, _id, before, after, position}. The \
query is matched against the document after the change, for a deletion against the document before it. `by` is the \
command that made the change, or what a client of `rmem serve` calls itself.

The history is kept where keep_history in rmem.toml says so. `rmem undo` takes changes back, and --at of query, \
count, dump, gen-problem and plan rerun reads the memory as it was. Times are in UTC.";

/// Print what changed, by which command or program, and when
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct HistoryArgs {
    /// Which changes.
    #[command(flatten)]
    pub changes: ChangesArgs,
    /// Print the last N changes only
    #[arg(long, value_name = "N")]
    pub limit: Option<usize>,
    /// Show the metadata of documents, under `_robmem_info`
    #[arg(long)]
    pub meta: bool,
}

/// Which changes of a history; shared with `undo`.
#[derive(Debug, Clone, Args)]
pub struct ChangesArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Query that selects documents (default: all documents)
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Changes after a time only: 14:03:20 (UTC), a date, or 10m for the last ten minutes
    #[arg(long, value_name = "TIME", value_parser = at::past)]
    pub since: Option<DateTime>,
    /// Changes by a command or program whose name contains NAME
    #[arg(long, value_name = "NAME")]
    pub by: Option<String>,
}

impl ChangesArgs {
    /// Returns what is selected, of all positions.
    pub(super) fn selection(&self) -> Result<Selection> {
        Ok(Selection {
            namespace: self.namespace.clone(),
            filter: argument("<query>", &self.query)?,
            since: self.since,
            by: self.by.clone(),
            positions: Vec::new(),
        })
    }
}

pub(super) fn run(args: &HistoryArgs, context: &mut Context<'_>) -> Result<Exit> {
    let selection = args.changes.selection()?;
    let memory = context.memory()?;
    let query = [("<query>", args.changes.query.as_str())];
    let entries = memory.history(&selection).map_err(|error| blame(error, &query))?;
    let ns = &selection.namespace;
    match memory.history_state(ns)? {
        HistoryState::Coming => {
            let message = format!(
                "{ns} was not changed since rmem.toml has keep_history; its history begins with the next write"
            );
            context.output.note(&message);
        }
        HistoryState::Ending => {
            let message = format!("keep_history is off for {ns}: these changes go with the next write");
            context.output.warn(&message);
        }
        HistoryState::None | HistoryState::Kept => {}
    }
    let listed = entries.map(|entry| Ok(listed(&selection.namespace, &entry?, args.meta)?));
    let printed = match args.limit {
        // A table of changes is one list in order of time, whatever each of them has.
        None => context.print_rows(listed)?,
        Some(most) => context.print_rows(last(listed, most).into_iter())?,
    };
    if printed == 0 {
        missing::warn_of_nearest(ns, &memory, context);
    }
    Ok(Exit::Done)
}

/// Returns the last of the items.
fn last<T>(items: impl Iterator<Item = T>, most: usize) -> std::collections::VecDeque<T> {
    let mut kept = std::collections::VecDeque::new();
    for item in items {
        kept.push_back(item);
        if kept.len() > most {
            kept.pop_front();
        }
    }
    kept
}
