//! `rmem distinct NS FIELD [QUERY]`: the distinct values of a field, one a line.

use bson::Bson;

use super::Context;
use super::query::{argument, blame};
use crate::cli::Distinct;
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;

pub(super) fn run(args: &Distinct, context: &mut Context<'_>) -> anyhow::Result<Exit> {
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
