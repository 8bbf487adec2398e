//! `rmem expire`: remove what is no longer to be remembered.

use bson::{Document, doc};
use clap::Args;

use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::memory::expiry::Expired;
use crate::saturate::to_i64;
use crate::store::{Namespace, NamespaceError};

/// What stands below the help of `expire`.
const HELP: &str = "\
Examples:
  rmem insert robmem.sightings \"{object: 'cup', _robmem_info: {decay_time: ISODate('2030-01-01')}}\"
  rmem expire
  rmem expire --restart
  rmem expire --most robmem.sightings=1000

Removes documents whose _robmem_info.decay_time is past, documents of computables whose cache time is over, and \
documents that rmem index --ttl expires. With --restart, also removes documents that were stored with _robmem_info: \
{persistent: false}. Prints the numbers for each collection.

A document past its decay_time is invisible in any case: the next write removes it, on MongoDB the server within a \
minute.

A collection of most_documents in rmem.toml, or of --most, keeps at most so many documents: those that were inserted \
first go, and are counted as surplus.

[most_documents]
\"robmem.sightings\" = 1000";

/// Remove expired documents, and others after a restart
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct ExpireArgs {
    /// Remove documents stored with `_robmem_info: {persistent: false}`, too
    #[arg(long)]
    pub restart: bool,
    /// Keep at most N documents of a collection, the newest (can be repeated)
    #[arg(long, value_name = "NS=N", value_parser = limit)]
    pub most: Vec<(Namespace, u64)>,
}

/// Reads the limit of a collection.
fn limit(text: &str) -> Result<(Namespace, u64), String> {
    let (namespace, most) = text.rsplit_once('=').ok_or("expected NS=N, like robmem.sightings=1000")?;
    let most = most.parse().map_err(|_| format!("expected a number of documents, found `{most}`"))?;
    Ok((namespace.parse().map_err(|error: NamespaceError| error.to_string())?, most))
}

pub(super) fn run(args: &ExpireArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let (mut expired, mut done) = memory.expire(args.restart);
    let mut limits = context.settings.most_documents.clone();
    limits.extend(args.most.iter().cloned());
    for (namespace, most) in limits {
        let surplus = match memory.expire_surplus(&namespace, most) {
            Ok(surplus) => surplus,
            // Another collection may be in a store that can be reached.
            Err(error) => {
                done = done.and(Err(error));
                continue;
            }
        };
        match expired.iter_mut().find(|(known, _)| *known == namespace) {
            Some((_, expired)) => expired.surplus += surplus,
            None if surplus > 0 => expired.push((namespace, Expired { surplus, ..Expired::default() })),
            None => {}
        }
    }
    context.print_rows(expired.iter().map(|(namespace, expired)| Ok(report(namespace, expired))))?;
    done?;
    Ok(Exit::Done)
}

fn report(namespace: &Namespace, expired: &Expired) -> Document {
    let count = to_i64::<u64>;
    let mut report = doc! {
        "namespace": namespace.to_string(),
        "decayed": count(expired.decayed),
        "computed": count(expired.computed),
        "due": count(expired.due),
        "not_persistent": count(expired.not_persistent),
    };
    if expired.surplus > 0 {
        report.insert("surplus", count(expired.surplus));
    }
    report
}
