//! `rmem collections`: the collections of the memory, sorted.

use bson::doc;
use clap::Args;

use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::shell;
use crate::memory::Listed;
use crate::store::index;
use crate::store::validation::collection_options;

/// List the collections
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem collections", arg = formats::argument(&formats::TEXT))]
pub struct CollectionsArgs {
    /// Print the options of each collection, too: its validator and its collation; of a view or time series, its definition
    #[arg(long)]
    pub options: bool,
}

pub(super) fn run(args: &CollectionsArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    // One store may be out of reach: what is in the other one is worth knowing all the same.
    let (names, all) = memory.reachable_collections();
    if !args.options {
        let names = names.into_iter().map(|namespace| namespace.to_string());
        context.print_lines(names.map(|name| (name.clone(), name.into())))?;
        all?;
        return Ok(Exit::Done);
    }
    let mut described = Vec::with_capacity(names.len());
    for name in names {
        let options = match memory.collection_or_view(&name)? {
            Listed::Collection(indexes) => {
                collection_options(memory.validation(&name)?.as_ref(), index::collation(&indexes).as_ref())
            }
            Listed::View(definition) | Listed::TimeSeries(definition) => definition,
        };
        let line = format!("{name} {}", shell::relaxed(&options));
        described.push((line, doc! { "ns": name.to_string(), "options": options }.into()));
    }
    context.print_lines(described)?;
    all?;
    Ok(Exit::Done)
}
