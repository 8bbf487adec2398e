//! `rmem find-and-modify NS QUERY (UPDATE | --remove)`: one document, found and changed in one step.

use bson::Document;
use clap::Args;

use super::query::{argument, blame, fields, filter_of, owned};
use super::update::{check, specification};
use super::{Context, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::Source;
use crate::store::{FindAndModify, Modification, Modifiers, Namespace};

/// What stands below the help of `find-and-modify`.
const HELP: &str = "\
Examples:
  rmem find-and-modify robmem.orders \"{state: 'open'}\" \"{\\$set: {state: 'taken'}}\" --sort '{due: 1}'
  rmem find-and-modify robmem.counters \"{_id: 'order'}\" '{$inc: {n: 1}}' --upsert --new
  rmem find-and-modify robmem.queue '{}' --remove

Changes the first document that matches, in one step: of several robots that ask for the next order, each gets \
another one. Prints the document as it was, or with --new as it is now. Exits with 1 if none matches.";

/// Find a document, change or remove it, and print it
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct FindAndModifyArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Query that selects documents, or - for stdin
    #[arg(value_name = "QUERY")]
    pub query: String,
    /// Update operators, a pipeline, or with --replace a whole document; - is stdin
    #[arg(value_name = "UPDATE", required_unless_present = "remove", conflicts_with = "remove")]
    pub update: Option<String>,
    /// Remove the document
    #[arg(long)]
    pub remove: bool,
    /// Sort order that decides which document is the first, e.g. '{due: 1}'
    #[arg(long, value_name = "KEYS", allow_hyphen_values = true)]
    pub sort: Option<String>,
    /// Print the document after the change
    #[arg(long, conflicts_with = "remove")]
    pub new: bool,
    /// Insert a document if none matches
    #[arg(long, conflicts_with = "remove")]
    pub upsert: bool,
    /// Replace the document as a whole, but for its _id
    #[arg(long, conflicts_with = "remove")]
    pub replace: bool,
    /// Condition for the elements of `$[identifier]` (can be repeated)
    #[arg(long = "array-filter", value_name = "QUERY", conflicts_with = "remove")]
    pub array_filters: Vec<String>,
    /// Show the metadata of the document, under `_robmem_info`
    #[arg(long)]
    pub meta: bool,
}

pub(super) fn run(args: &FindAndModifyArgs, context: &mut Context<'_>) -> Result<Exit> {
    let filter = filter_of(&args.namespace, &args.query)?;
    let sort = args.sort.as_deref().map(|text| fields("<sort>", "--sort ", text)).transpose()?.unwrap_or_default();
    let request = FindAndModify {
        filter,
        sort,
        modification: modification(args)?,
        new: args.new,
        projection: Document::new(),
        modifiers: Modifiers::default(),
    };
    let memory = context.memory()?;
    let texts = [
        ("<update>", args.update.as_deref().unwrap_or_default()),
        ("<query>", args.query.as_str()),
        ("<sort>", args.sort.as_deref().unwrap_or_default()),
    ];
    let modified = match args.meta {
        true => memory.find_and_modify_with_metadata(&args.namespace, &request),
        false => memory.find_and_modify(&args.namespace, &request),
    }
    .map_err(|error| blame(error, &texts))?;
    if let Some(document) = modified.document {
        context.print_document(owned(document)?)?;
    }
    if !modified.is_found && modified.upserted.is_none() {
        if !missing::warn(&args.namespace, &memory, context) {
            context.output.note("no document matches");
        }
        return Ok(Exit::No);
    }
    Ok(Exit::Done)
}

fn modification(args: &FindAndModifyArgs) -> Result<Modification> {
    let Some(text) = &args.update else { return Ok(Modification::Remove) };
    let update = specification(&Source::new("<update>", text.as_str()))?;
    check(text, args.replace, &update)?;
    let array_filters = args.array_filters.iter().map(|text| argument("<array-filter>", text));
    Ok(Modification::Update { update, array_filters: array_filters.collect::<Result<_, _>>()?, upsert: args.upsert })
}
