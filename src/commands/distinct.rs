//! `rmem distinct NS FIELD [QUERY]`: the distinct values of a field, one a line.

use super::{Context, query::argument};
use crate::cli::Distinct;
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;

pub(super) fn run(args: &Distinct, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let filter = argument("<query>", &args.query)?;
    let format = context.format(&[Format::Jsonl, Format::Canonical])?;
    for value in context.memory()?.distinct(&args.namespace, &args.field, &filter)? {
        let line =
            if format == Format::Canonical { shell::canonical_value(&value) } else { shell::relaxed_value(&value) };
        context.output.line(&line)?;
    }
    Ok(Exit::Done)
}
