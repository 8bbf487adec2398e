//! `rmem expire`: remove what is no longer to be remembered.

use bson::{Document, doc};
use clap::Args;

use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::memory::expiry::Expired;
use crate::store::Namespace;

/// What stands below the help of `expire`.
const HELP: &str = "\
Examples:
  rmem insert robmem.sightings \"{object: 'cup', _robmem_info: {decay_time: ISODate('2030-01-01')}}\"
  rmem expire
  rmem expire --restart

Removes documents whose _robmem_info.decay_time is past, documents of computables whose cache time is over, and \
documents that rmem index --ttl expires. With --restart, also removes documents that were stored with _robmem_info: \
{persistent: false}. Prints the numbers for each collection.

A document past its decay_time is invisible in any case: the next write removes it, on MongoDB the server within a \
minute.";

/// Remove expired documents, and others after a restart
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct ExpireArgs {
    /// Remove documents stored with `_robmem_info: {persistent: false}`, too
    #[arg(long)]
    pub restart: bool,
}

pub(super) fn run(args: &ExpireArgs, context: &mut Context<'_>) -> Result<Exit> {
    let expired = context.memory()?.expire(args.restart)?;
    context.print_rows(expired.iter().map(|(namespace, expired)| Ok(report(namespace, expired))))?;
    Ok(Exit::Done)
}

fn report(namespace: &Namespace, expired: &Expired) -> Document {
    let count = |number: u64| i64::try_from(number).unwrap_or(i64::MAX);
    doc! {
        "namespace": namespace.to_string(),
        "decayed": count(expired.decayed),
        "computed": count(expired.computed),
        "due": count(expired.due),
        "not_persistent": count(expired.not_persistent),
    }
}
