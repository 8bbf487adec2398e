//! `rmem computables`: the declared and the kept ones; with `--check`, which a query would run and why; adding to the
//! memory, and removing from it.

use std::path::{Path, PathBuf};

use bson::{Bson, Document, doc};
use clap::builder::NonEmptyStringValueParser;
use clap::{Args, Subcommand};

use super::query::argument;
use super::{Context, UsageError, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{Diagnostic, Source, shell};
use crate::memory::computables::{Check, Computable, Definition, Origin, Verdict, read};
use crate::settings::{Settings, read_kept};
use crate::store::Namespace;

/// What stands below the help of `computables`.
const HELP: &str = "\
Examples:
  rmem computables
  rmem computables --check robmem.blocks \"{relation: 'on-table'}\"
  rmem computables add --file below.toml
  rmem computables remove below

A computable is a [[computable]] table of rmem.toml: a name, a collection, a spec, and one body: a pipeline, a \
command, or a builtin (transform, nearest). When a query on the collection matches the spec, the computable runs \
and its documents become part of the result. With a cache time, an equal query within that time computes nothing. \
A pipeline or a builtin can be kept in the memory instead (rmem computables add); it is for everyone who uses the memory.

In a pipeline, '$$query.KEY' is the value of a key of the query:

[[computable]]
name = \"below\"
collection = \"robmem.blocks\"
spec = \"{below: {$exists: true}}\"
pipeline = \"\"\"[
  {$match: {z: {$lt: '$$query.below'}}},
  {$project: {_id: 0, block: 1, below: '$$query.below'}}]\"\"\"";

/// List, check, add and remove computables
#[derive(Debug, Args)]
#[command(after_help = HELP, args_conflicts_with_subcommands = true)]
#[command(arg = formats::argument(&formats::DOCUMENTS))]
pub struct ComputablesArgs {
    /// What to do (default: list them).
    #[command(subcommand)]
    pub command: Option<ComputablesCommand>,
    /// Print which computables a query on a collection would run, and why; run none
    #[arg(long, num_args = 2, value_names = ["NS", "QUERY"])]
    pub check: Vec<String>,
}

/// The commands of `computables`.
#[derive(Debug, Subcommand)]
pub enum ComputablesCommand {
    List(ListArgs),
    Add(AddArgs),
    Remove(RemoveArgs),
}

/// What stands below the help of `computables list`.
const LIST_HELP: &str = "\
Examples:
  rmem computables list --format table

They are listed in the order in which they run. `origin` is the line of the settings file, or the collection of the \
memory that keeps the computable. Two of one name are an error.";

/// List the computables of the settings and of the memory
#[derive(Debug, Args)]
#[command(after_help = LIST_HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct ListArgs {}

/// What stands below the help of `computables add`.
const ADD_HELP: &str = "\
Examples:
  rmem computables add --file below.toml
  rmem computables add \"{name: 'low', collection: 'robmem.blocks', spec: {relation: 'on-table'},
    pipeline: [{\\$match: {z: {\\$lt: 0.1}}},
    {\\$project: {_id: 0, relation: 'on-table', object: '\\$block'}}]}\"

Takes the keys of a [[computable]] table of rmem.toml: a TOML file has such tables, a document has the same keys (spec \
and pipeline as documents, or as text). Prints the name of each. All are added or, after an error, none.

The computable is kept in the collection rmem.computables of its collection's database, and every process that uses the \
memory runs it from then on, rmem serve among them (on MongoDB, at most a second later). Programs (command) stay in \
settings files: others write to the memory, and what they write must not run programs on this machine.";

/// Keep computables in the memory
#[derive(Debug, Args)]
#[command(after_help = ADD_HELP, arg = formats::argument(&formats::TEXT))]
pub struct AddArgs {
    /// Computables as documents, in shell syntax or Extended JSON (-: from stdin)
    #[arg(value_name = "COMPUTABLE", required_unless_present = "file")]
    pub computables: Vec<String>,
    /// Read computables from a file: TOML if it ends in .toml, else documents
    #[arg(short, long, value_name = "FILE", conflicts_with = "computables")]
    pub file: Option<PathBuf>,
}

/// What stands below the help of `computables remove`.
const REMOVE_HELP: &str = "\
Examples:
  rmem computables remove below

Exits with 1 if the memory keeps none of that name.";

/// Remove computables from the memory
#[derive(Debug, Args)]
#[command(after_help = REMOVE_HELP, arg = formats::argument(&formats::TEXT))]
pub struct RemoveArgs {
    /// Names of computables
    #[arg(value_name = "NAME", required = true, value_parser = NonEmptyStringValueParser::new())]
    pub names: Vec<String>,
}

pub(super) fn run(args: &ComputablesArgs, context: &mut Context<'_>) -> Result<Exit> {
    match &args.command {
        Some(ComputablesCommand::Add(args)) => return add(args, context),
        Some(ComputablesCommand::Remove(args)) => return remove(args, context),
        Some(ComputablesCommand::List(_)) | None => {}
    }
    let memory = context.memory()?;
    let (mut wrong, mut all) = (Vec::new(), Ok(()));
    let rows: Vec<Document> = match args.check.as_slice() {
        [namespace, query] => {
            let namespace: Namespace = namespace.parse()?;
            let query = argument("<query>", query)?;
            memory.check_computables(&namespace, &query)?.iter().map(checked).collect()
        }
        _ => {
            // One store may be out of reach: what is in the other one is worth knowing all the same.
            let (computables, complaints, reached) = memory.reachable_computables()?;
            (wrong, all) = (complaints, reached);
            computables.iter().map(|computable| listed(computable)).collect()
        }
    };
    if rows.is_empty() && wrong.is_empty() && all.is_ok() {
        context.output.note(
            "there are no computables; they are [[computable]] tables in rmem.toml, or added by rmem computables add",
        );
    }
    context.print_rows(rows.into_iter().map(Ok))?;
    wrong.iter().for_each(|wrong| context.output.error(wrong));
    all?;
    Ok(if wrong.is_empty() { Exit::Done } else { Exit::BadInput })
}

/// Keeps computables in the memory, and prints their names.
fn add(args: &AddArgs, context: &mut Context<'_>) -> Result<Exit> {
    let mut computables: Vec<Vec<Definition>> = Vec::new();
    match &args.file {
        Some(path) if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("toml")) => {
            computables = read_kept(&context.read(path)?)?;
        }
        Some(path) => computables.extend(documents(&context.read(path)?)?),
        None => {
            let is_one = args.computables.len() == 1;
            for (index, text) in args.computables.iter().enumerate() {
                let name = if is_one { "<argument>".to_owned() } else { format!("<argument {}>", index + 1) };
                let source = if text == "-" { context.read(Path::new("-"))? } else { Source::new(name, text.as_str()) };
                computables.extend(documents(&source)?);
            }
        }
    }
    if computables.is_empty() {
        return Err(
            UsageError::new("there is no computable to add; expected a [[computable]] table, or a document").into()
        );
    }
    context.memory_to_fill()?.keep_computables(&computables)?;
    let names = computables.iter().filter_map(|definitions| definitions.first()).map(|first| first.name.clone());
    context.print_lines(names.map(|name| (name.clone(), name.into())))?;
    Ok(Exit::Done)
}

/// The computables that are documents of a text.
fn documents(source: &Source) -> Result<Vec<Vec<Definition>>, Diagnostic> {
    let documents = shell::parse_documents(source)?;
    let computables = documents.into_iter().map(|(span, document)| {
        let origin = Origin::Settings(source.name().to_owned());
        read(&document, &origin).map_err(|wrong| Diagnostic::new(source, span, wrong))
    });
    computables.collect()
}

/// Removes computables from the memory, and prints the names of those that were there.
fn remove(args: &RemoveArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let mut removed = Vec::new();
    let result = args.names.iter().try_for_each(|name| -> Result<()> {
        match memory.forget_computable(name)? {
            Some((_, others)) => {
                removed.push(name);
                for other in others {
                    let note = format!("{other} keeps another computable `{name}`; remove once more takes that away");
                    context.output.note(&note);
                }
            }
            None => context.output.error(&unknown(name, &context.settings)),
        }
        Ok(())
    });
    // What was removed before a failure is printed all the same.
    context.print_lines(removed.iter().map(|name| ((*name).clone(), (*name).into())))?;
    result?;
    Ok(if removed.len() == args.names.len() { Exit::Done } else { Exit::No })
}

/// The message about a computable that the memory does not keep.
fn unknown(name: &str, settings: &Settings) -> String {
    match settings.computables.iter().find(|declared| declared.name == name) {
        Some(declared) => {
            format!("`{name}` is a computable of {}, not of the memory; remove it there", declared.origin)
        }
        None => format!("the memory keeps no computable `{name}`; `rmem computables` lists those there are"),
    }
}

/// A registered computable.
fn listed(computable: &Computable) -> Document {
    let definition = &computable.definition;
    let mut listed = doc! {
        "name": &definition.name,
        "collection": definition.namespace.to_string(),
        "spec": definition.spec.clone(),
        "priority": definition.priority,
        "cache": definition.cache.map_or(Bson::Null, |cache| format!("{cache:?}").into()),
        "body": computable.describe(),
        "origin": definition.origin.to_string(),
    };
    if let Some(keys) = &definition.adds {
        listed.insert("adds", if keys.is_empty() { Bson::Boolean(true) } else { Bson::from(keys.clone()) });
    }
    listed
}

/// What a query means for a computable.
fn checked(check: &Check) -> Document {
    let (runs, why) = match &check.verdict {
        Verdict::Runs => (true, "the query matches the spec".to_owned()),
        Verdict::Cached { until, documents } => {
            let until = until.try_to_rfc3339_string().unwrap_or_else(|_| until.to_string());
            (false, format!("the cache holds {documents} documents for an equal query until {until}"))
        }
        Verdict::Busy => (false, "another process computes for an equal query, and is waited for".to_owned()),
        Verdict::Unneeded(clauses) => {
            let clauses: Vec<String> = clauses.iter().map(shell::relaxed).collect();
            (false, format!("the query does not match {} of the spec", clauses.join(" and ")))
        }
        Verdict::Elsewhere => (false, format!("it computes documents of {}", check.computable.definition.namespace)),
    };
    doc! { "name": &check.computable.definition.name, "runs": runs, "why": why }
}
