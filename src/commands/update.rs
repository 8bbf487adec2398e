//! `rmem update NS QUERY UPDATE`: change documents.

use bson::{Bson, Document};
use clap::Args;

use super::delete::others;
use super::modifiers::ModifierArgs;
use super::query::{argument, blame, filter_of};
use super::{Context, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::interrupt::InterruptGuard;
use crate::saturate::to_i64;
use crate::store::{Namespace, Query, UpdateRequest, UpdateSpec};

/// What stands below the help of `update`.
const HELP: &str = "\
Examples:
  rmem update robmem.worldmodel \"{object: 'A'}\" '{$set: {color: \"red\"}}'
  rmem update robmem.worldmodel \"{relation: 'on'}\" '{$set: {seen: true}}' --many
  rmem update robmem.worldmodel \"{_id: 1}\" \"{object: 'A', color: 'red'}\" --replace

Changes the first document that matches, and reports if more match. Prints the numbers of matched and modified \
documents, and the _id of an inserted one.";

/// Change documents
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::RESULT))]
pub struct UpdateArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Query that selects documents, or - for stdin
    #[arg(value_name = "QUERY")]
    pub query: String,
    /// Update operators, a pipeline, or with --replace a whole document; - is stdin
    #[arg(value_name = "UPDATE")]
    pub update: String,
    /// Change all documents that match (default: the first)
    #[arg(long)]
    pub many: bool,
    /// Insert a document if none matches
    #[arg(long)]
    pub upsert: bool,
    /// Replace the document as a whole, but for its _id
    #[arg(long, conflicts_with = "many")]
    pub replace: bool,
    /// Condition for the elements of `$[identifier]` (can be repeated)
    #[arg(long = "array-filter", value_name = "QUERY")]
    pub array_filters: Vec<String>,
    /// How strings compare, variables, and the index to read.
    #[command(flatten)]
    pub modifiers: ModifierArgs,
}

pub(super) fn run(args: &UpdateArgs, context: &mut Context<'_>) -> Result<Exit> {
    let request = UpdateRequest {
        filter: filter_of(&args.namespace, &args.query)?,
        update: specification(&Source::new("<update>", args.update.as_str()))?,
        array_filters: args
            .array_filters
            .iter()
            .map(|text| argument("<array-filter>", text))
            .collect::<Result<_, _>>()?,
        many: args.many,
        upsert: args.upsert,
        modifiers: args.modifiers.read()?,
    };
    check(&args.update, args.replace, &request.update)?;
    let memory = context.memory()?;
    let query = Query { filter: &request.filter, modifiers: &request.modifiers };
    let matching = if args.many { None } else { others(&args.namespace, query, &memory, context)? };
    let guard = args.many.then(InterruptGuard::stopping);
    let updated = memory.update(&args.namespace, &request);
    drop(guard);
    let texts = [("<update>", args.update.as_str()), ("<query>", &args.query), args.modifiers.hint()];
    let updated = updated.map_err(|error| blame(error, &texts))?;
    let is_missing = updated.matched == 0 && updated.upserted.is_none();
    let mut result = bson::doc! { "matched": count(updated.matched), "modified": count(updated.modified) };
    if let Some(id) = updated.upserted {
        result.insert("upserted", id);
    }
    context.print_result(result)?;
    match matching {
        Some(count) => {
            context.output.note(&format!("{} of {count} matching documents; use --many for all", updated.matched))
        }
        None if is_missing => drop(missing::warn(&args.namespace, &memory, context)),
        None => {}
    }
    Ok(Exit::Done)
}

/// Refuses a whole document without `--replace`, and anything else with it.
pub(super) fn check(text: &str, is_replacement: bool, update: &UpdateSpec) -> Result<(), Diagnostic> {
    let is_whole = matches!(update, UpdateSpec::Document(update) if !update.keys().any(|key| key.starts_with('$')));
    let (message, hint) = match (is_whole, is_replacement) {
        (true, false) => (
            "expected update operators, found a whole document",
            "write {$set: {…}} to change fields, or --replace to replace the document as a whole",
        ),
        (false, true) => ("expected a whole document for --replace", "leave --replace out for operators and pipelines"),
        _ => return Ok(()),
    };
    let source = Source::new("<update>", text);
    Err(Diagnostic::new(&source, Span::new(0, source.text().len()), message).hint(hint))
}

/// An update is a document, or a pipeline in brackets.
pub(super) fn specification(source: &Source) -> Result<UpdateSpec, Diagnostic> {
    match shell::parse_value(source)? {
        Bson::Document(document) => Ok(UpdateSpec::Document(document)),
        Bson::Array(stages) => {
            let stages: Option<Vec<Document>> = stages
                .into_iter()
                .map(|stage| match stage {
                    Bson::Document(stage) => Some(stage),
                    _ => None,
                })
                .collect();
            let whole = Span::new(0, source.text().len());
            stages
                .map(UpdateSpec::Pipeline)
                .ok_or_else(|| Diagnostic::new(source, whole, "expected an array of stages"))
        }
        _ => {
            Err(Diagnostic::new(source, Span::new(0, source.text().len()), "expected a document or an array of stages")
                .hint("like {$set: {color: 'red'}}"))
        }
    }
}

fn count(number: u64) -> i64 {
    to_i64(number)
}
