//! `rmem expire`: remove what is no longer to be remembered.

use bson::{Document, doc};

use super::Context;
use crate::cli::Expire;
use crate::exit::Exit;
use crate::memory::expiry::Expired;
use crate::store::Namespace;

pub(super) fn run(args: &Expire, context: &mut Context<'_>) -> anyhow::Result<Exit> {
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
