//! `rmem undo NS [QUERY]`: changes taken back.

use bson::{Document, doc};
use clap::Args;

use super::history::ChangesArgs;
use super::query::blame;
use super::{Context, UsageError, formats, missing};
use crate::calendar::day_and_time;
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{shell, visible};
use crate::memory::Memory;
use crate::memory::history::Selection;
use crate::memory::undo::{DEFAULT_LAST, PartialRun, Restoration, UndoPlan};
use crate::output::{Format, amount};
use crate::saturate::to_i64;
use crate::store::{Entry, StoreError, metadata};

/// What stands below the help of `undo`.
const HELP: &str = "\
Examples:
  rmem undo robmem.worldmodel
  rmem undo robmem.worldmodel --last 3 --dry-run
  rmem undo robmem.worldmodel --by camera --since 10m
  rmem undo robmem.worldmodel --change 17

Takes back what the last run of a command changed in the collection, all documents of an update --many together. The \
documents become what they were, with their metadata; what was dropped comes back without its indexes. With --since, \
--by or --change, all changes that are selected are taken back; --last limits them.

Where documents were changed again later, nothing is done, and the later changes are printed (exit code 5); --force \
overwrites them. Exits with 1 where nothing is to be taken back, or \
where the oldest changes of a run are not kept any more (history_size, keep_history); --partial takes back those that are. `undo` is itself in the history: after it, `undo` takes the undo back.";

/// Take changes back, as the history has them
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::RESULT))]
pub struct UndoArgs {
    /// Which changes.
    #[command(flatten)]
    pub changes: ChangesArgs,
    /// Take back the last N runs of commands (default: 1, or all that is selected)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub last: Option<u64>,
    /// Take back the change at this position of `rmem history` (can be repeated)
    #[arg(long = "change", value_name = "POSITION")]
    pub positions: Vec<String>,
    /// Overwrite later changes
    #[arg(long)]
    pub force: bool,
    /// Take back what is left of a run whose oldest changes are not kept any more
    #[arg(long)]
    pub partial: bool,
    /// Print what each document would become, and do nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Show the metadata of documents, under `_robmem_info`
    #[arg(long, requires = "dry_run")]
    pub meta: bool,
}

pub(super) fn run(args: &UndoArgs, context: &mut Context<'_>) -> Result<Exit> {
    let selection = Selection { positions: args.positions.clone(), ..args.changes.selection()? };
    let ns = &selection.namespace;
    let memory = context.memory()?;
    let query = [("<query>", args.changes.query.as_str())];
    let unknown = unknown(&selection, &memory)?;
    if !unknown.is_empty() {
        let message = format!(
            "the history of {ns} has no change at the position {}; rmem history {ns} lists the positions",
            unknown.join(", ")
        );
        return Err(UsageError::new(message).into());
    }
    let last = last(args);
    let plan = memory.plan_undo(&selection, last).map_err(|error| blame(error, &query))?;
    if let Some(run) = plan.partial.as_ref().filter(|_| !args.partial) {
        print(None, result(&UndoPlan::default()), context)?;
        context.output.error(&incomplete(run));
        return Ok(Exit::No);
    }
    if !args.dry_run {
        if let Some(what) = conflicts(&plan).filter(|_| !args.force) {
            return Err(StoreError::Held { what }.into());
        }
        memory.undo_unless_changed(&selection, last, &plan)?;
        if let Some(newest) = plan.newest.as_ref().filter(|_| !plan.documents.is_empty()) {
            let others = if plan.changes > 1 { ", the newest of them" } else { "" };
            context.output.note(&format!(
                "took back {}{others}: {}",
                amount(plan.changes as u64, "change"),
                later(newest)
            ));
        }
    }
    let would = args.dry_run.then(|| plan.documents.iter().map(|document| described(document, args.meta)).collect());
    print(would, result(&plan), context)?;
    if plan.changes > 0 && plan.documents.is_empty() {
        let what = if plan.changes == 1 { "this change" } else { "these changes" };
        let message = format!("the documents of {ns} are already what they were before {what}; nothing was done");
        context.output.error(&message);
        return Ok(Exit::No);
    }
    if plan.changes == 0 {
        context.output.error(&format!("no change of {ns} is to be taken back"));
        missing::warn_of_nearest(ns, &memory, context);
        return Ok(Exit::No);
    }
    Ok(Exit::Done)
}

/// Returns the positions that no change has.
fn unknown(selection: &Selection, memory: &Memory) -> Result<Vec<String>> {
    let mut unknown = selection.positions.clone();
    if !unknown.is_empty() {
        let named = Selection { filter: Document::new(), since: None, by: None, ..selection.clone() };
        for entry in memory.history(&named)? {
            let entry = entry?;
            unknown.retain(|position| *position != entry.change.position);
        }
    }
    Ok(unknown)
}

/// Returns how many runs are taken back; all that is selected where something is selected.
fn last(args: &UndoArgs) -> Option<usize> {
    let is_selected = args.changes.since.is_some() || args.changes.by.is_some() || !args.positions.is_empty();
    let last = args.last.map(|last| usize::try_from(last).unwrap_or(usize::MAX));
    last.or((!is_selected).then_some(DEFAULT_LAST))
}

fn result(plan: &UndoPlan) -> Document {
    let count = to_i64::<usize>;
    let removed = plan.documents.iter().filter(|document| document.target.is_none()).count();
    doc! {
        "changes": count(plan.changes),
        "restored": count(plan.documents.len() - removed),
        "removed": count(removed),
    }
}

/// Says which run is not kept as a whole.
fn incomplete(run: &PartialRun) -> String {
    let author = run.newest.author.as_ref().map(|author| format!(" of {}", visible::line(author))).unwrap_or_default();
    let time = day_and_time(run.newest.change.time.timestamp_millis());
    let are_kept = if run.kept == 1 { "is kept" } else { "are kept" };
    format!(
        "of the run{author} that ended at {time} UTC, {} {are_kept}, and the older ones are not any more (history_size \
         and keep_history in rmem.toml); nothing was done, --partial takes back what is kept",
        amount(run.kept as u64, "change"),
    )
}

/// Says which later changes would be overwritten.
fn conflicts(plan: &UndoPlan) -> Option<String> {
    let lines: Vec<String> = plan.conflicts().flat_map(overwritten).collect();
    if lines.is_empty() {
        return None;
    }
    Some(format!("this would overwrite later changes; nothing was done, --force does it\n{}", lines.join("\n")))
}

fn overwritten(document: &Restoration) -> Vec<String> {
    let id = shell::relaxed_value(&document.id);
    if document.later.is_empty() {
        return vec![format!("  {id}: is not what the history says, so it was changed outside of it")];
    }
    document.later.iter().map(|entry| format!("  {id}: {}", later(entry))).collect()
}

fn later(entry: &Entry) -> String {
    let by = entry.author.as_ref().map(|author| format!(" by {}", visible::line(author))).unwrap_or_default();
    let time = day_and_time(entry.change.time.timestamp_millis());
    format!("{}{by} at {time} UTC (position {})", entry.change.kind.name(), entry.change.position)
}

/// Prints what would be done: a line for each document before the result, or all in one document.
fn print(would: Option<Vec<Document>>, mut result: Document, context: &mut Context<'_>) -> Result<()> {
    match (would, context.format(&formats::RESULT)?) {
        (Some(documents), Format::Json) => drop(result.insert("documents", documents)),
        (documents, _) => {
            documents.into_iter().flatten().try_for_each(|one| context.output.line(&shell::relaxed(&one)))?;
        }
    }
    context.print_result(result)
}

/// What a document would become; null where it would be removed.
fn described(document: &Restoration, meta: bool) -> Document {
    let mut target = document.target.clone();
    if let (Some(target), false) = (&mut target, meta) {
        target.remove(metadata::INFO);
    }
    doc! { "_id": document.id.clone(), "becomes": target, "overwrites_later_changes": document.is_conflict() }
}
