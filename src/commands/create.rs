//! `rmem create NS`: make an empty collection, whose strings may compare by a collation, and which may take certain documents
//! only.

use bson::doc;
use clap::Args;

use super::modifiers::CollationArgs;
use super::validation::ValidationArgs;
use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::store::{Namespace, Validation};

/// What stands below the help of `create`.
const HELP: &str = "\
Examples:
  rmem create robmem.objects --collation '{locale: \"en\", strength: 2}'
  rmem create robmem.boxes --validator '{$jsonSchema: {required: [\"weight\"]}}'

A collection is made with its first document, too; it has no collation then. The collation of a collection is that of \
all operations on it, and of its indexes, that have none of their own: {locale: \"simple\"} compares byte by byte. It \
cannot be changed. Documents that do not match a validator are refused (exit code 5); rmem coll-mod changes it.";

/// Create an empty collection
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::TEXT))]
pub struct CreateArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// How the strings of the collection compare.
    #[command(flatten)]
    pub collation: CollationArgs,
    /// Which documents the collection takes.
    #[command(flatten)]
    pub validation: ValidationArgs,
}

pub(super) fn run(args: &CreateArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::TEXT)?;
    let collation = args.collation.read()?.filter(|collation| !collation.is_simple());
    let validation = Validation::read(&args.validation.options()?)?;
    let (namespace, memory) = (&args.namespace, context.memory()?);
    let made = memory.create_validating(namespace, collation.as_ref(), &validation, None);
    let made = made.map_err(|error| args.validation.blame(error))?;
    context.print_report([], doc! { "ns": namespace.to_string(), "created": made })?;
    if !made && memory.collation(namespace)? != collation {
        let text = format!("{namespace} exists with another collation, which cannot be changed; drop it first");
        context.output.warn(&text);
        return Ok(Exit::No);
    }
    if !made && args.validation.is_given() && memory.validation(namespace)?.unwrap_or_default() != validation {
        let text = format!("{namespace} exists and takes other documents; `rmem coll-mod {namespace}` changes that");
        context.output.warn(&text);
        return Ok(Exit::No);
    }
    if !made {
        context.output.note(&format!("{namespace} exists already"));
    }
    Ok(Exit::Done)
}
