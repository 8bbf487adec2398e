//! `rmem clips import [FILE]`: CLIPS facts as documents.

use std::collections::BTreeMap;
use std::path::PathBuf;

use bson::doc;
use clap::Args;

use super::schema;
use crate::clips::facts::{Found, Importer, Schema, give_ids};
use crate::commands::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::clips::{Item, Reader};
use crate::formats::{Diagnostic, Source};
use crate::store::Namespace;

/// What stands below the help of `clips import`.
const HELP: &str = "\
Example:
  rmem clips import facts.txt --into robmem.worldmodel --deftemplates templates.clp --key sync-id

Reads facts as (save-facts) writes them, what (facts) lists, deffacts, and the facts in programs.";

/// Store CLIPS facts as documents, all or none
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::RESULT))]
pub struct ImportArgs {
    /// File with facts, deffacts or a program (default: -, which is stdin)
    #[arg(value_name = "FILE", default_value = "-", hide_default_value = true)]
    pub file: PathBuf,
    /// Collection to store into (default: --collection)
    #[arg(long, value_name = "NS")]
    pub into: Option<Namespace>,
    /// File with deftemplates, which check facts and give defaults (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub deftemplates: Vec<PathBuf>,
    /// Slot that identifies facts: a fact replaces the document with the same value
    #[arg(long, value_name = "SLOT")]
    pub key: Option<String>,
    /// Fail if a fact has no deftemplate
    #[arg(long)]
    pub strict: bool,
}

/// How many names of a kind are printed.
const NAMES: usize = 10;

pub(super) fn run(args: &ImportArgs, context: &mut Context<'_>) -> Result<Exit> {
    let schema = schema::read(&args.deftemplates, context)?;
    let progress = context.output.progress("importing facts");
    let source = context.read(&args.file)?;
    let namespace = args.into.clone().unwrap_or_else(|| context.settings.collection.value.clone());
    let (mut found, skipped) = documents(&source, schema, args)?;
    let memory = context.memory_to_fill()?.with_meter(progress.meter());
    if let Some(key) = &args.key {
        give_ids(key, &source, &mut found, &memory, &namespace)?;
    }
    let put = memory.put(&namespace, found.into_iter().map(|(_, document)| document).collect())?;
    drop(progress);
    let count = |number: u64| i64::try_from(number).unwrap_or(i64::MAX);
    let result =
        doc! { "inserted": count(put.inserted), "replaced": count(put.replaced), "unchanged": count(put.same) };
    context.print_result(result)?;
    report(&skipped, context);
    Ok(Exit::Done)
}

/// The names of what was passed over, by kind.
type Skipped = BTreeMap<String, Vec<String>>;

/// The documents of a text.
fn documents(source: &Source, mut schema: Schema, args: &ImportArgs) -> Result<(Found, Skipped), Diagnostic> {
    let names: Vec<String> = schema.names().map(str::to_owned).collect();
    let (mut documents, mut skipped) = (Vec::new(), Skipped::new());
    for item in Reader::new(source, names) {
        match item? {
            Item::Template(template) => schema.add(template),
            Item::Skipped { kind, name } => skipped.entry(kind).or_default().push(name),
            Item::Fact(fact) => {
                let importer = Importer { schema: &schema, strict: args.strict };
                let document =
                    importer.document(&fact).map_err(|error| Diagnostic::new(source, error.span, error.message))?;
                documents.push((fact.span, document));
            }
        }
    }
    Ok((documents, skipped))
}

/// Says what was passed over.
fn report(skipped: &Skipped, context: &mut Context<'_>) {
    for (kind, names) in skipped {
        let named: Vec<&str> = names.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
        let more = named.len().saturating_sub(NAMES);
        let shown = named.iter().take(NAMES).copied().collect::<Vec<_>>().join(", ");
        let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
        let list = if shown.is_empty() { String::new() } else { format!(": {shown}{rest}") };
        context.output.note(&format!("passed over {} {kind}{list}", names.len()));
    }
}
