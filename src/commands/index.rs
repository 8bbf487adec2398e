//! `rmem index NS [KEYS]`: make, remove or list indexes.

use std::time::Duration;

use clap::Args;

use super::modifiers::CollationArgs;
use super::query::{argument, blame, fields};
use super::{Context, UsageError, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{Diagnostic, quantity, shell};
use crate::memory::Memory;
use crate::output::Format;
use crate::store::{Index, IndexChange, Namespace};

/// What stands below the help of `index`.
const HELP: &str = "\
Examples:
  rmem index robmem.objects '{name: 1}' --unique
  rmem index robmem.sightings '{seen: 1}' --ttl 1h
  rmem index robmem.objects \"{name: 'text', note: 'text'}\" --weights '{name: 3}'
  rmem index robmem.objects '{name: 1}' --unique --partial '{seen: true}'
  rmem index robmem.objects
  rmem index robmem.objects '{name: 1}' --drop
  rmem index robmem.objects name_1 --hide

Prints the name of the created index. With --unique, a document whose key another one has is refused (exit code 5), \
and the index is not created if two documents have the same key. Documents that --ttl expires are removed by the next \
write, by rmem expire, or by a running rmem serve; on MongoDB, by the server. Dates are compared with the clock at that time: if it is set \
forward, documents are removed earlier.";

/// Create, remove or list indexes
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct IndexArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Keys, each with 1, -1, '2d', '2dsphere', 'hashed' or 'text', e.g. '{name: 1}' (default: list the indexes)
    #[arg(value_name = "KEYS")]
    pub keys: Option<String>,
    /// Refuse documents whose key another document has
    #[arg(long)]
    pub unique: bool,
    /// Leave documents out that have none of the keys
    #[arg(long)]
    pub sparse: bool,
    /// Remove documents this long after the date in their key
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub ttl: Option<Duration>,
    /// Name of the index (default: made of its keys, e.g. a_1_b_-1)
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Documents that are in the index, e.g. '{seen: true}' (default: all)
    #[arg(long, value_name = "QUERY")]
    pub partial: Option<String>,
    /// Keep the index, but answer no queries with it
    #[arg(long)]
    pub hidden: bool,
    /// Weights of the fields of a text index, e.g. '{name: 3}' (default: 1 each)
    #[arg(long, value_name = "WEIGHTS")]
    pub weights: Option<String>,
    /// Language of a text index: english or none (default: english)
    #[arg(long, value_name = "LANGUAGE")]
    pub language: Option<String>,
    /// How the strings of the index compare.
    #[command(flatten)]
    pub collation: CollationArgs,
    /// Answer no queries with the index with these keys or this name
    #[arg(long, conflicts_with_all = ["unique", "sparse", "ttl", "partial", "hidden", "weights", "language", "collation"])]
    pub hide: bool,
    /// Answer queries with that index again
    #[arg(long, conflicts_with_all = ["unique", "sparse", "ttl", "partial", "hidden", "weights", "language", "collation", "hide"])]
    pub unhide: bool,
    /// Remove the index with these keys or this name
    #[arg(long, conflicts_with_all = ["unique", "sparse", "ttl", "partial", "hidden", "weights", "language", "collation", "hide", "unhide"])]
    pub drop: bool,
}

pub(super) fn run(args: &IndexArgs, context: &mut Context<'_>) -> Result<Exit> {
    let wanted = args.keys.as_deref().filter(|text| !is_name(args, text)).map(|text| index(args, text)).transpose()?;
    let memory = context.memory()?;
    if args.hide || args.unhide {
        return hide(args, wanted, &memory, context);
    }
    match (wanted, args.drop) {
        (wanted, true) => remove(args, wanted, &memory, context),
        (None, false) if describes(args) => {
            Err(UsageError::new("an index needs keys; expected KEYS, like '{name: 1}'").into())
        }
        (None, false) => {
            let indexes = memory.indexes(&args.namespace)?;
            context.print_rows(indexes.iter().map(|index| Ok(index.definition())))?;
            Ok(Exit::Done)
        }
        (Some(index), false) => {
            let progress = context.output.progress(&format!("making the index {} of {}", index.name, args.namespace));
            let made = memory.create_index(&args.namespace, &index);
            drop(progress);
            let made = made.map_err(|error| blame(error, &texts(args)))?;
            if !made {
                context.output.note(&format!("{} has the index {} already", args.namespace, index.name));
            }
            let name = match context.format(&formats::DOCUMENTS)? {
                Format::Json | Format::Canonical => shell::relaxed_value(&index.name.into()),
                _ => index.name,
            };
            context.output.line(&name)?;
            Ok(Exit::Done)
        }
    }
}

/// Whether a text in the place of the keys names an index that is there, as mongosh takes it.
fn is_name(args: &IndexArgs, text: &str) -> bool {
    (args.hide || args.unhide || args.drop) && !text.trim_start().starts_with('{')
}

/// Whether the arguments say how an index is to be.
fn describes(args: &IndexArgs) -> bool {
    let options = [&args.name, &args.partial, &args.weights, &args.language];
    let is_described = args.unique || args.sparse || args.hidden || args.collation.is_given();
    is_described || args.ttl.is_some() || options.iter().any(|option| option.is_some())
}

/// The texts that an error may be about.
fn texts(args: &IndexArgs) -> Vec<(&'static str, &str)> {
    let all = [("<partial>", &args.partial), ("<weights>", &args.weights), ("<keys>", &args.keys)];
    all.into_iter().filter_map(|(name, text)| Some((name, text.as_deref()?))).collect()
}

/// Says how weights are written.
fn weigh(error: Diagnostic) -> Diagnostic {
    error.hint("weights are those of fields: --weights '{name: 3}'; a field that is left out has 1")
}

/// The index that the arguments describe.
fn index(args: &IndexArgs, keys: &str) -> Result<Index> {
    let mut index = Index::on(fields("<keys>", "", keys)?);
    if let Some(collation) = args.collation.read()? {
        index.other.insert("collation", collation.definition().clone());
    }
    if let Some(partial) = &args.partial {
        index.other.insert("partialFilterExpression", argument("<partial>", partial)?);
    }
    if args.hidden {
        index.other.insert("hidden", true);
    }
    if let Some(weights) = &args.weights {
        index.other.insert("weights", argument("<weights>", weights).map_err(weigh)?);
    }
    if let Some(language) = &args.language {
        index.other.insert("default_language", language);
    }
    Ok(Index {
        name: args.name.clone().unwrap_or(index.name),
        unique: args.unique,
        sparse: args.sparse,
        expire_after: args.ttl.map(seconds).transpose()?,
        ..index
    })
}

/// MongoDB counts in whole seconds.
fn seconds(ttl: Duration) -> Result<i64, UsageError> {
    match i64::try_from(ttl.as_secs()) {
        Ok(seconds) if ttl.subsec_nanos() == 0 && seconds <= i64::from(i32::MAX) => Ok(seconds),
        _ => Err(UsageError::new("--ttl takes whole seconds, at most 2147483647 of them")),
    }
}

/// The name of an index that is there, by its keys or as it is given.
fn present(args: &IndexArgs, wanted: Option<Index>, memory: &Memory, verb: &str) -> Result<String> {
    let given = args.keys.as_ref().filter(|text| is_name(args, text));
    match (args.name.as_ref().or(given), wanted) {
        (Some(name), _) => Ok(name.clone()),
        (None, Some(wanted)) => named(memory, &args.namespace, wanted),
        (None, None) => {
            let message = format!(
                "expected the index to {verb}: KEYS, like '{{name: 1}}', or --name NAME (`rmem index NS` lists both)"
            );
            Err(UsageError::new(message).into())
        }
    }
}

fn hide(args: &IndexArgs, wanted: Option<Index>, memory: &Memory, context: &mut Context<'_>) -> Result<Exit> {
    let name = present(args, wanted, memory, if args.hide { "hide" } else { "unhide" })?;
    let change = IndexChange { hidden: Some(args.hide), expire_after: None };
    if !memory.modify_index(&args.namespace, &name, change)? {
        context.output.warn(&format!("{} has no index {name}", args.namespace));
    }
    Ok(Exit::Done)
}

fn remove(args: &IndexArgs, wanted: Option<Index>, memory: &Memory, context: &mut Context<'_>) -> Result<Exit> {
    let name = present(args, wanted, memory, "drop")?;
    if !memory.drop_index(&args.namespace, &name)? {
        context.output.warn(&format!("{} has no index {name}", args.namespace));
    }
    Ok(Exit::Done)
}

/// What the index with these keys is called.
fn named(memory: &Memory, ns: &Namespace, wanted: Index) -> Result<String> {
    let with_keys = |index: &Index| index.has_keys(&wanted.keys);
    let found: Vec<String> = memory.indexes(ns)?.into_iter().filter(with_keys).map(|index| index.name).collect();
    match found.as_slice() {
        [] => Ok(wanted.name),
        [name] => Ok(name.clone()),
        names => {
            let text = format!("{} indexes have these keys: {}; expected --name", names.len(), names.join(", "));
            Err(UsageError::new(text).into())
        }
    }
}
