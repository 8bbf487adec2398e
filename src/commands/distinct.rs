//! `rmem distinct NS FIELD [QUERY]`: the distinct values of a field, one a line.

use bson::Bson;
use clap::Args;

use super::Context;
use super::query::{argument, blame};
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::store::Namespace;

/// Print the distinct values of a field
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem distinct robmem.worldmodel object \"{relation: 'on-table'}\"")]
pub struct DistinctArgs {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// A field, or a path with dots
    #[arg(value_name = "FIELD")]
    pub field: String,
    /// Among which documents; all where it is left out
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
}

pub(super) fn run(args: &DistinctArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let filter = argument("<query>", &args.query)?;
    let format = context.format(&[Format::Jsonl, Format::Json, Format::Canonical, Format::Table])?;
    let values = context.memory()?.distinct(&args.namespace, &args.field, &filter);
    let values = values.map_err(|error| blame(error, &[("<query>", &args.query)]))?;
    if format == Format::Json {
        context.output.line(&shell::pretty(&Bson::Array(values)))?;
        return Ok(Exit::Done);
    }
    for value in values {
        let line = match (format, &value) {
            (Format::Canonical, value) => shell::canonical_value(value),
            (_, value) => shell::relaxed_value(value),
        };
        context.output.line(&line)?;
    }
    Ok(Exit::Done)
}
