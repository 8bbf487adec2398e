//! `rmem computables`: the registered ones; with `--check`, which a query would run and why.

use bson::{Bson, Document, doc};
use clap::Args;

use super::query::argument;
use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::shell;
use crate::memory::computables::{Check, Computable, Verdict};
use crate::store::Namespace;

/// What stands below the help of `computables`.
const HELP: &str = "\
Examples:
  rmem computables
  rmem computables --check robmem.blocks \"{relation: 'on-table'}\"

A computable is a [[computable]] table of rmem.toml: a name, a collection, a spec, and one body: a pipeline, a \
command, or a builtin (transform, nearest). When a query on the collection matches the spec, the computable runs \
and its documents become part of the result. With a cache time, an equal query within that time computes nothing.

In a pipeline, '$$query.KEY' is the value of a key of the query:

[[computable]]
name = \"below\"
collection = \"robmem.blocks\"
spec = \"{below: {$exists: true}}\"
pipeline = \"\"\"[
  {$match: {z: {$lt: '$$query.below'}}},
  {$project: {_id: 0, block: 1, below: '$$query.below'}}]\"\"\"";

/// List the computables, or check which a query would run
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct ComputablesArgs {
    /// Print which computables a query on a collection would run, and why; run none
    #[arg(long, num_args = 2, value_names = ["NS", "QUERY"])]
    pub check: Vec<String>,
}

pub(super) fn run(args: &ComputablesArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let rows: Vec<Document> = match args.check.as_slice() {
        [namespace, query] => {
            let namespace: Namespace = namespace.parse()?;
            let query = argument("<query>", query)?;
            memory.check_computables(&namespace, &query)?.iter().map(checked).collect()
        }
        _ => memory.computables().map(listed).collect(),
    };
    if rows.is_empty() {
        context.output.note("no computables are declared; they are [[computable]] tables in rmem.toml");
    }
    context.print_rows(rows.into_iter().map(Ok))?;
    Ok(Exit::Done)
}

/// A registered computable.
fn listed(computable: &Computable) -> Document {
    let definition = &computable.definition;
    let mut listed = doc! {
        "name": &definition.name,
        "collection": definition.namespace.to_string(),
        "spec": definition.spec.clone(),
        "priority": definition.priority,
        "cache": definition.cache.map_or(Bson::Null, |cache| format!("{cache:?}").into()),
        "body": computable.describe(),
    };
    if let Some(keys) = &definition.adds {
        listed.insert("adds", if keys.is_empty() { Bson::Boolean(true) } else { Bson::from(keys.clone()) });
    }
    listed
}

/// What a query means for a computable.
fn checked(check: &Check<'_>) -> Document {
    let (runs, why) = match &check.verdict {
        Verdict::Runs => (true, "the query matches the spec".to_owned()),
        Verdict::Cached { until, documents } => {
            let until = until.try_to_rfc3339_string().unwrap_or_else(|_| until.to_string());
            (false, format!("the cache holds {documents} documents for an equal query until {until}"))
        }
        Verdict::Busy => (false, "another process computes for an equal query, and is waited for".to_owned()),
        Verdict::Unneeded(clauses) => {
            let clauses: Vec<String> = clauses.iter().map(shell::relaxed).collect();
            (false, format!("the query does not match {} of the spec", clauses.join(" and ")))
        }
        Verdict::Elsewhere => (false, format!("it computes documents of {}", check.computable.definition.namespace)),
    };
    doc! { "name": &check.computable.definition.name, "runs": runs, "why": why }
}
