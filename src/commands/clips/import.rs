//! `rmem clips import [FILE]`: CLIPS facts as documents.

use std::collections::BTreeMap;
use std::path::PathBuf;

use bson::doc;
use clap::Args;

use super::schema;
use crate::clips::facts::{Found, Importer, Schema, give_ids, remove_repeated, remove_stored, spelled};
use crate::commands::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::clips::{Item, Reader};
use crate::formats::{Diagnostic, Source};
use crate::store::Namespace;

/// What stands below the help of `clips import`.
const HELP: &str = "\
Examples:
  rmem clips import facts.txt --into robmem.worldmodel --deftemplates templates.clp --key sync-id
  rmem clips import machines.clp --key name,team

Reads facts as (save-facts) writes them, what (facts) lists, deffacts, and the facts in programs. Equal facts are one \
fact, as in CLIPS, also if one of them is in the collection already.";

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
    /// File with deftemplates, which check facts and give defaults, and defglobals (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub deftemplates: Vec<PathBuf>,
    /// Slots that identify facts: a fact replaces the document with the same values (can be repeated)
    #[arg(long, value_name = "SLOT,…", value_delimiter = ',')]
    pub key: Vec<String>,
    /// Fail if a fact has no deftemplate
    #[arg(long)]
    pub strict: bool,
}

/// How many names of a kind are printed.
const NAMES: usize = 10;

pub(super) fn run(args: &ImportArgs, context: &mut Context<'_>) -> Result<Exit> {
    let mut schema = schema::read(&args.deftemplates, context)?;
    let progress = context.output.progress("importing facts");
    let source = context.read(&args.file)?;
    let namespace = args.into.clone().unwrap_or_else(|| context.settings.collection.value.clone());
    let (mut found, skipped) = documents(&source, &mut schema, args)?;
    let repeated = remove_repeated(&mut found);
    let memory = context.memory_to_fill()?.with_meter(progress.meter());
    let stored = match args.key.as_slice() {
        [] => remove_stored(&mut found, &memory, &namespace)?,
        keys => {
            let keys = &spelled(keys, &found, &schema.respelled);
            give_ids(keys, &source, &mut found, &memory, &namespace, &schema.respelled)?;
            0
        }
    };
    let put = memory.put(&namespace, found.into_iter().map(|(_, document)| document).collect())?;
    drop(progress);
    let count = |number: u64| i64::try_from(number).unwrap_or(i64::MAX);
    let unchanged = put.same + u64::try_from(stored).unwrap_or(u64::MAX);
    let result =
        doc! { "inserted": count(put.inserted), "replaced": count(put.replaced), "unchanged": count(unchanged) };
    context.print_result(result)?;
    schema.respelled.take().iter().for_each(|name| context.output.note(name));
    if repeated > 0 {
        context.output.note(&format!("{} in the text more than once; each was imported once", facts(repeated)));
    }
    if stored > 0 {
        context.output.note(&format!("{} in {namespace} already", facts(stored)));
    }
    report(&skipped, context);
    Ok(Exit::Done)
}

/// `1 fact was`, `2 facts were`.
fn facts(count: usize) -> String {
    if count == 1 { "1 fact was".to_owned() } else { format!("{count} facts were") }
}

/// The names of what was passed over, by kind.
type Skipped = BTreeMap<String, Vec<String>>;

/// The documents of a text.
fn documents(source: &Source, schema: &mut Schema, args: &ImportArgs) -> Result<(Found, Skipped), Diagnostic> {
    let names: Vec<String> = schema.names().map(str::to_owned).collect();
    let (mut documents, mut skipped) = (Vec::new(), Skipped::new());
    for item in Reader::new(source, names).with_globals(std::mem::take(&mut schema.globals)) {
        match item? {
            Item::Template(template) => schema.add(template),
            Item::Skipped { kind, name } => skipped.entry(kind).or_default().push(name),
            Item::Fact(fact) => {
                let importer = Importer { schema, strict: args.strict };
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
