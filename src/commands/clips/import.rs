//! `rmem clips import [FILE]`: CLIPS facts as documents.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::PathBuf;

use bson::{Bson, Document, doc};
use clap::Args;

use super::schema;
use crate::clips::facts::{INITIAL, Importer, RELATION, Schema};
use crate::commands::query::owned;
use crate::commands::{Context, WrongInput};
use crate::exit::Exit;
use crate::formats::clips::{Item, Reader};
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::memory::Memory;
use crate::store::{Find, Namespace};

/// Store facts as documents, all or none
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  rmem clips import facts.txt --into robmem.worldmodel --deftemplates templates.clp --key sync-id"
)]
pub struct ImportArgs {
    /// Facts, deffacts, or a program; - or nothing is stdin
    #[arg(value_name = "FILE", default_value = "-", hide_default_value = true)]
    pub file: PathBuf,
    /// Where the documents go; else --collection
    #[arg(long, value_name = "NS")]
    pub into: Option<Namespace>,
    /// Texts with deftemplates, which are checked and give defaults (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub deftemplates: Vec<PathBuf>,
    /// A slot that tells facts apart: a fact replaces the document with the same value
    #[arg(long, value_name = "SLOT")]
    pub key: Option<String>,
    /// Every template has to be known
    #[arg(long)]
    pub strict: bool,
}

/// How many keys are looked up at once.
const BATCH: usize = 1_000;

/// How many names of a kind are told.
const NAMES: usize = 10;

pub(super) fn run(args: &ImportArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let schema = schema(&args.deftemplates, context)?;
    let source = context.read(&args.file)?;
    let namespace = args.into.clone().unwrap_or_else(|| context.settings.collection.value.clone());
    let (mut found, skipped) = documents(&source, schema, args)?;
    let memory = context.memory_to_fill()?;
    if let Some(key) = &args.key {
        replace(key, &source, &mut found, &memory, &namespace)?;
    }
    let put = memory.put(&namespace, found.into_iter().map(|(_, document)| document).collect())?;
    let line = format!("{{\"inserted\":{},\"replaced\":{},\"unchanged\":{}}}", put.inserted, put.replaced, put.same);
    context.output.line(&line)?;
    tell(&skipped, context);
    Ok(Exit::Done)
}

/// The names of what was passed over, by kind.
type Skipped = BTreeMap<String, Vec<String>>;

/// Documents, each with the place of its fact.
type Found = Vec<(Span, Document)>;

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

/// Gives each document the `_id` of the stored one with the same key.
fn replace(
    key: &str,
    source: &Source,
    documents: &mut Found,
    memory: &Memory,
    namespace: &Namespace,
) -> anyhow::Result<()> {
    // CLIPS asserts this one by itself; it tells nothing.
    let initial = |document: &Document| document.get_str(RELATION).is_ok_and(|name| name == INITIAL);
    documents.retain(|(_, document)| !initial(document));
    let mut seen = HashMap::new();
    for (span, document) in documents.iter() {
        let value = match document.get(key) {
            None => return Err(Diagnostic::new(source, *span, format!("expected the slot `{key}`, the key")).into()),
            Some(Bson::Array(_)) => {
                return Err(
                    Diagnostic::new(source, *span, format!("expected one value in the slot `{key}`, the key")).into()
                );
            }
            Some(value) => value,
        };
        if let Some(first) = seen.insert(identity(value), *span) {
            let (line, column) = source.position(first.start);
            let message = format!("another fact has the key `{key}` {}", shell::relaxed_value(value));
            return Err(Diagnostic::new(source, *span, message).hint(format!("it stands at {line}:{column}")).into());
        }
    }
    for batch in documents.chunks_mut(BATCH) {
        let values: Vec<Bson> = batch.iter().filter_map(|(_, document)| document.get(key).cloned()).collect();
        let stored = stored(key, values, memory, namespace)?;
        for (_, document) in batch {
            if let Some(id) = document.get(key).and_then(|value| stored.get(&identity(value))) {
                let rest = std::mem::take(document);
                *document = doc! { "_id": id.clone() }.into_iter().chain(rest).collect();
            }
        }
    }
    Ok(())
}

/// The `_id`s of the documents with these keys.
fn stored(
    key: &str,
    values: Vec<Bson>,
    memory: &Memory,
    namespace: &Namespace,
) -> anyhow::Result<HashMap<String, Bson>> {
    let find = Find { filter: doc! { key: { "$in": values } }, projection: doc! { key: 1 }, ..Find::default() };
    let mut ids = HashMap::new();
    let mut twice = HashSet::new();
    for document in memory.find(namespace, &find)? {
        let mut document = document.and_then(owned)?;
        let (Some(value), Some(id)) = (document.remove(key), document.remove("_id")) else { continue };
        let name = identity(&value);
        if ids.insert(name.clone(), id).is_some() && twice.insert(name) {
            let value = shell::relaxed_value(&value);
            let message = format!("{namespace} holds two documents with the key `{key}` {value}; nothing was imported");
            return Err(WrongInput::new(message).into());
        }
    }
    Ok(ids)
}

/// What is equal for values that the memory takes as equal.
#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "only exact numbers are converted")]
fn identity(value: &Bson) -> String {
    match value {
        Bson::Int32(number) => number.to_string(),
        Bson::Int64(number) => number.to_string(),
        Bson::Double(number) if number.trunc() == *number && number.abs() < 9e18 => (*number as i64).to_string(),
        other => shell::canonical_value(other),
    }
}

/// Says what was passed over.
fn tell(skipped: &Skipped, context: &mut Context<'_>) {
    for (kind, names) in skipped {
        let named: Vec<&str> = names.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
        let more = named.len().saturating_sub(NAMES);
        let shown = named.iter().take(NAMES).copied().collect::<Vec<_>>().join(", ");
        let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
        let list = if shown.is_empty() { String::new() } else { format!(": {shown}{rest}") };
        context.output.note(&format!("passed over {} {kind}{list}", names.len()));
    }
}
