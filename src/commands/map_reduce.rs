//! `rmem map-reduce NS --map FUNCTION --reduce FUNCTION`: values reduced by key, with functions in JavaScript.

use std::path::Path;

use clap::Args;

use super::Context;
use super::query::{argument, blame, filter_of};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::formats::{Diagnostic, Source, Span};
use crate::query::collation::during;
use crate::query::{MapReduce, Merging};
use crate::store::{Find, Namespace, StoreError};

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
    let (map, reduce) = (function("<map>", &args.map, context)?, function("<reduce>", &args.reduce, context)?);
    let finalize = args.finalize.as_deref().map(|text| function("<finalize>", text, context)).transpose()?;
    let texts = [Some(&map), Some(&reduce), finalize.as_ref()];
    let scope = argument("<scope>", &args.scope)?;
    let functions = MapReduce::parse(map.text(), reduce.text(), finalize.as_ref().map(Source::text), &scope)?;
    let find = Find {
        filter: filter_of(&args.namespace, &args.query)?,
        sort: argument("<sort>", &args.sort)?,
        limit: args.limit,
        ..Find::default()
    };
    let given = [("<query>", args.query.as_str()), ("<sort>", args.sort.as_str())];
    let memory = context.memory()?;
    let documents = memory.find(&args.namespace, &find).map_err(|error| blame(error, &given))?;
    let collation = memory.collation(&args.namespace)?;
    let results = during(collation.as_ref(), || functions.run(documents));
    let results = results.map_err(|error| located(error, &texts).unwrap_or_else(|error| blame(error, &given)))?;
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
fn function(name: &'static str, text: &str, context: &mut Context<'_>) -> Result<Source> {
    match text.strip_prefix('@') {
        Some(path) => context.read(Path::new(path)),
        None => Ok(Source::new(name, text)),
    }
}

/// The error of a function, shown at its text; any other comes back.
fn located(error: StoreError, texts: &[Option<&Source>; 3]) -> Result<Error, StoreError> {
    let StoreError::Query(query) = &error else { return Err(error) };
    let named = |function| MapReduce::FUNCTIONS.iter().zip(texts).find(|(name, _)| **name == function);
    let source = query.function().and_then(named).and_then(|(_, source)| *source);
    let Some(source) = source else { return Err(error) };
    let text = source.text();
    let start = text.len() - text.trim_start().len();
    Ok(Diagnostic::new(source, Span::new(start, text.trim_end().len()), query.message.clone()).into())
}
