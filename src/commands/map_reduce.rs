//! `rmem map-reduce NS --map FUNCTION --reduce FUNCTION`: values reduced by key, with functions in JavaScript.

use clap::Args;

use super::Context;
use super::query::{argument, blame, filter_of};
use crate::error::{Context as _, Result};
use crate::exit::Exit;
use crate::query::collation::during;
use crate::query::{MapReduce, Merging};
use crate::store::{Find, Namespace};

/// Reduce values by key, with functions in JavaScript
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  rmem map-reduce robmem.worldmodel --map 'function() { emit(this.relation, 1) }' \\\n    \
                  --reduce 'function(key, values) { return Array.sum(values) }'"
)]
#[command(arg = crate::commands::formats::argument(&crate::commands::formats::DOCUMENTS))]
pub struct MapReduceArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Function that sees a document as `this` and calls emit(key, value), or @FILE
    #[arg(long, value_name = "FUNCTION")]
    pub map: String,
    /// Function of a key and an array of values that returns one value, or @FILE
    #[arg(long, value_name = "FUNCTION")]
    pub reduce: String,
    /// Function of a key and its value that returns the final value, or @FILE
    #[arg(long, value_name = "FUNCTION")]
    pub finalize: Option<String>,
    /// Query for the documents to map (default: all documents)
    #[arg(long, value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Sort order of the documents, e.g. '{name: 1}' (-1 is descending)
    #[arg(long, value_name = "SORT", default_value = "{}", hide_default_value = true)]
    pub sort: String,
    /// Map at most N documents
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub limit: u64,
    /// Variables for the functions, e.g. '{factor: 2}'
    #[arg(long, value_name = "DOC", default_value = "{}", hide_default_value = true)]
    pub scope: String,
    /// Replace this collection by the results, instead of printing them
    #[arg(long, value_name = "NS")]
    pub out: Option<Namespace>,
}

pub(super) fn run(args: &MapReduceArgs, context: &mut Context<'_>) -> Result<Exit> {
    let (map, reduce) = (function(&args.map)?, function(&args.reduce)?);
    let finalize = args.finalize.as_deref().map(function).transpose()?;
    let functions = MapReduce::parse(&map, &reduce, finalize.as_deref(), &argument("<scope>", &args.scope)?)?;
    let find = Find {
        filter: filter_of(&args.namespace, &args.query)?,
        sort: argument("<sort>", &args.sort)?,
        limit: args.limit,
        ..Find::default()
    };
    let texts = [("<query>", args.query.as_str()), ("<sort>", args.sort.as_str())];
    let memory = context.memory()?;
    let documents = memory.find(&args.namespace, &find).map_err(|error| blame(error, &texts))?;
    let collation = memory.collation(&args.namespace)?;
    let results = during(collation.as_ref(), || functions.run(documents)).map_err(|error| blame(error, &texts))?;
    match &args.out {
        Some(out) => {
            let stages = Merging::Replace.stages(&out.database, &out.collection, results);
            memory.aggregate(out, &stages)?.try_for_each(|document| document.map(drop))?;
        }
        None => drop(context.print_documents(results.into_iter().map(Ok))?),
    }
    Ok(Exit::Done)
}

/// Returns the text of a function, which `@FILE` has in a file.
fn function(text: &str) -> Result<String> {
    match text.strip_prefix('@') {
        Some(path) => std::fs::read_to_string(path).with_context(|| format!("cannot read {path}")),
        None => Ok(text.to_owned()),
    }
}
