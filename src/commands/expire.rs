//! `rmem expire`: remove what is no longer to be remembered.

use bson::{Document, doc};
use clap::Args;

use super::Context;
use crate::exit::Exit;
use crate::memory::expiry::Expired;
use crate::store::Namespace;

/// Remove what decayed, and what is not to outlive a restart
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  rmem insert robmem.sightings \"{object: 'cup', _robmem_info: {decay_time: ISODate('2030-01-01')}}\"\n  rmem expire\n  rmem expire --restart\n\n\
Removes documents whose _robmem_info.decay_time is past, what computables made and may not be\n\
used any more, and what is due by rmem index --ttl; with --restart, also what was stored with\n\
_robmem_info: {persistent: false}. Prints how many, a line a collection. What decayed is invisible\n\
without it: it is removed by later writers, on MongoDB by the server, within a minute or so."
)]
pub struct ExpireArgs {
    /// Also what was stored with `_robmem_info: {persistent: false}`: the robot was restarted
    #[arg(long)]
    pub restart: bool,
}

pub(super) fn run(args: &ExpireArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let expired = context.memory()?.expire(args.restart)?;
    context.print_documents(expired.iter().map(|(namespace, expired)| Ok(report(namespace, expired))))?;
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
