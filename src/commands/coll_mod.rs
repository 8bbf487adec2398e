//! `rmem coll-mod NS`: change which documents a collection takes.

use bson::doc;
use clap::Args;

use super::validation::ValidationArgs;
use super::{Context, UsageError, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::store::Namespace;
use crate::store::validation::collection_options;

/// What stands below the help of `coll-mod`.
const HELP: &str = "\
Examples:
  rmem coll-mod robmem.boxes --validator '{weight: {$gt: 0}}'
  rmem coll-mod robmem.boxes --validation-level moderate --validation-action warn
  rmem coll-mod robmem.boxes --validator '{}'

What is not said stays as it is, and an empty query removes the validator. Documents that are there already are not checked: \
rmem query NS '{$nor: [QUERY]}' prints those that do not match. A write that is refused exits with 5. \
`rmem collections --options` prints what is set.";

/// Change which documents a collection takes
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::TEXT))]
pub struct CollModArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Which documents the collection takes.
    #[command(flatten)]
    pub validation: ValidationArgs,
}

pub(super) fn run(args: &CollModArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::TEXT)?;
    let CollModArgs { namespace, validation } = args;
    if !validation.is_given() {
        let message =
            "expected what to change: --validator QUERY, --validation-level LEVEL or --validation-action ACTION";
        return Err(UsageError::new(message).into());
    }
    let options = validation.options()?;
    let memory = context.memory()?;
    missing::refuse(namespace, &memory, context)?;
    let changed = memory.validation(namespace)?.unwrap_or_default().changed(&options)?;
    memory.set_validation(namespace, &changed).map_err(|error| validation.blame(error))?;
    let options = collection_options(Some(&changed), memory.collation(namespace)?.as_ref());
    context.print_report([], doc! { "ns": namespace.to_string(), "options": options })?;
    Ok(Exit::Done)
}
