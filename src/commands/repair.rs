//! `rmem repair [-o FILE]`: what can be saved of a damaged file.

use std::path::PathBuf;

use bson::doc;
use clap::Args;

use super::{Context, UsageError, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::output::amount;
use crate::saturate::to_i64;
use crate::store::embedded::Repaired;
use crate::store::{Embedded, StoreError, StoreUri};

/// Rebuild the indexes of a file, or save what can be read of it
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  rmem doctor --deep\n  rmem repair\n  rmem repair -o saved.rmem\n\n\
Without -o, all indexes are rebuilt from the documents, in the file itself; a damaged document, or a damaged\n\
change in the log, stops that and nothing is changed. With -o, every document that can be read and whose checksum fits is copied\n\
into a new memory, with the indexes, the names of watches and the log of changes; what is lost is listed,\n\
which exits with 1. The damaged file stays as it is.")]
#[command(arg = formats::argument(&formats::TEXT))]
pub struct RepairArgs {
    /// Copy what can be read into this new file
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

pub(super) fn run(args: &RepairArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::TEXT)?;
    let uri = context.settings.memory.value.as_deref().map(StoreUri::parse).transpose()?;
    let path = uri
        .as_ref()
        .and_then(StoreUri::path)
        .ok_or_else(|| UsageError::new("only the file of a memory can be repaired; expected --memory file:PATH"))?;
    if path.metadata().is_err_and(|error| error.kind() == std::io::ErrorKind::NotFound) {
        return Err(StoreError::missing(format!("file:{}", path.display())).into());
    }
    let repaired = match &args.output {
        None => Embedded::open(path)?.rebuild_indexes()?,
        Some(output) => Embedded::salvage(path, output)?,
    };
    let Repaired { collections, documents, indexes, lost } = &repaired;
    let counts = [(*collections, "collection"), (*documents, "document"), (*indexes, "index")];
    let counts = counts.map(|(number, what)| amount(number, what)).join(", ");
    let lines = std::iter::once(counts).chain(lost.iter().map(|lost| format!("lost: {lost}")));
    let number = to_i64::<u64>;
    let report = doc! {
        "collections": number(*collections),
        "documents": number(*documents),
        "indexes": number(*indexes),
        "lost": lost.iter().map(ToString::to_string).collect::<Vec<_>>(),
    };
    context.print_report(lines, report)?;
    Ok(if lost.is_empty() { Exit::Done } else { Exit::No })
}
