//! `rmem diff A B`: what is different in two worlds, a line a document.

use std::path::Path;

use bson::{Bson, Document, RawDocumentBuf, doc};
use clap::Args;

use super::context::memory_at;
use super::restore::stdin;
use super::{Context, WrongInput, formats};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::formats::{nearest, shell};
use crate::memory::dump::diff::{Difference, Side, compare};
use crate::memory::dump::read::Dump;
use crate::output::Format;
use crate::store::Namespace;

/// What stands below the help of `diff`.
const HELP: &str = "\
Examples:
  rmem diff world.json file:robot.rmem
  rmem diff before.json after.json --format json
  rmem diff world.json file:robot.rmem --only robmem.worldmodel

Prints a line for each document that is only in A (-), only in B (+), or different (~). Exits with 0 if there is no \
difference, else with 1. Documents are paired by namespace and _id; metadata is not compared.";

/// Compare two world files, dumps or memories
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::TEXT))]
pub struct DiffArgs {
    /// World file, dump, or URI of a memory (file:PATH, mem:, mongodb://…)
    #[arg(value_name = "A")]
    pub first: String,
    /// The same, to compare with
    #[arg(value_name = "B")]
    pub second: String,
    /// Compare only this collection (can be repeated)
    #[arg(long, value_name = "NS")]
    pub only: Vec<Namespace>,
}

pub(super) fn run(args: &DiffArgs, context: &mut Context<'_>) -> Result<Exit> {
    let (first, second) = (side(&args.first, context)?, side(&args.second, context)?);
    refuse_unknown(&args.only, &[&first, &second])?;
    let is_json = context.format(&formats::TEXT)? == Format::Json;
    let mut differences = Vec::new();
    let count = compare(&first, &second, &args.only, |namespace, difference| {
        if is_json {
            differences.push(Bson::Document(document(&namespace.to_string(), difference)));
            return Ok::<_, Error>(());
        }
        Ok(context.output.line(&line(&namespace.to_string(), &difference))?)
    })?;
    if is_json {
        context.output.line(&shell::pretty(&Bson::Array(differences)))?;
    }
    Ok(if count == 0 { Exit::Done } else { Exit::No })
}

/// Refuses a collection that neither side has: its name is misspelt.
fn refuse_unknown(only: &[Namespace], sides: &[&Side]) -> Result<()> {
    if only.is_empty() {
        return Ok(());
    }
    let mut known = Vec::new();
    for side in sides {
        known.extend(side.namespaces()?);
    }
    let Some(unknown) = only.iter().find(|namespace| !known.contains(namespace)) else { return Ok(()) };
    let names: Vec<String> = known.iter().map(ToString::to_string).collect();
    let hint = nearest(&unknown.to_string(), names.iter().map(String::as_str));
    let hint = hint.map(|name| format!("; did you mean {name}?")).unwrap_or_default();
    Err(WrongInput::new(format!("neither A nor B has a collection {unknown}{hint}")).into())
}

fn side(text: &str, context: &mut Context<'_>) -> Result<Side> {
    let is_store = ["file:", "mem:", "mongodb:", "mongodb+srv:"].iter().any(|scheme| text.starts_with(scheme));
    // A scheme that no store has is named without what stands behind it: that may be a password.
    let is_uri = is_store || text.contains("://") && !Path::new(text).exists();
    Ok(match text {
        uri if is_uri => Side::Memory(memory_at(uri)?.expecting_files()),
        "-" => Side::Dump(stdin(context)?),
        path => Side::Dump(Dump::open(Path::new(path))?),
    })
}

/// `{namespace, before, after}`
fn document(namespace: &str, difference: Difference) -> Document {
    let (before, after) = match difference {
        Difference::Removed(document) => (document.into(), Bson::Null),
        Difference::Added(document) => (Bson::Null, document.into()),
        Difference::Changed(before, after) => (before.into(), after.into()),
    };
    doc! { "namespace": namespace, "before": before, "after": after }
}

fn line(namespace: &str, difference: &Difference) -> String {
    match difference {
        Difference::Removed(document) => format!("- {namespace} {}", shell::relaxed(document)),
        Difference::Added(document) => format!("+ {namespace} {}", shell::relaxed(document)),
        Difference::Changed(first, second) => {
            let id = first.get("_id").map(shell::relaxed_value).unwrap_or_default();
            let (old, new) = changes(first, second);
            format!("~ {namespace} {id} {old} -> {new}")
        }
    }
}

/// The keys that differ, with their values on both sides. Types are spelled
/// out where nothing else differs; where only the order of keys does, the
/// documents are whole.
fn changes(first: &Document, second: &Document) -> (String, String) {
    let differing = |document: &Document, other: &Document| -> Document {
        // NaN is not itself, but its bytes are.
        let bytes = |value: &Bson| RawDocumentBuf::try_from(&doc! { "": value }).ok();
        let same = |other: &Bson, value: &Bson| other == value || bytes(other) == bytes(value);
        let different = |key: &str, value: &Bson| !other.get(key).is_some_and(|other| same(other, value));
        document
            .iter()
            .filter(|(key, value)| different(key, value))
            .map(|(key, value)| (key.clone(), value.clone()))
            .collect()
    };
    let (mut old, mut new) = (differing(first, second), differing(second, first));
    if old.is_empty() && new.is_empty() {
        (old, new) = (first.clone(), second.clone());
    }
    let relaxed = (shell::relaxed(&old), shell::relaxed(&new));
    if relaxed.0 == relaxed.1 { (shell::canonical(&old), shell::canonical(&new)) } else { relaxed }
}
