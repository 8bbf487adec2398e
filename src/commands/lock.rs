//! `rmem lock NAME`: mutual exclusion between robots.

use std::time::Duration;

use super::{Context, UsageError};
use crate::cli::{HolderOptions, Lock};
use crate::exit::Exit;
use crate::formats::shell;
use crate::memory::lock::{Mutex, Tried};
use crate::store::{Namespace, NamespaceError};

/// The collection of mutexes, in its database.
const COLLECTION: &str = "mutexes";
/// The database where none is shared.
const DATABASE: &str = "robmem";

pub(super) fn run(args: &Lock, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let mutex = mutex(&args.name, &args.holder, context)?;
    let memory = context.memory_to_fill()?;
    match mutex.lock(&memory, args.ttl, args.wait.unwrap_or(Duration::ZERO))? {
        Tried::Done(document) => {
            context.output.line(&shell::relaxed(&document))?;
            Ok(Exit::Done)
        }
        Tried::Held(holder) => {
            context.output.error(&format!("{} is {holder}", args.name));
            Ok(Exit::Conflict)
        }
        Tried::Free => Ok(Exit::Conflict),
    }
}

/// The mutex that is meant, and by whom.
pub(super) fn mutex(name: &str, options: &HolderOptions, context: &Context<'_>) -> anyhow::Result<Mutex> {
    let set = |name: &str| context.environment.get(name).filter(|value| !value.is_empty());
    let owner = match (&options.owner, set("USER"), set("HOSTNAME")) {
        (Some(owner), _, _) => owner.clone(),
        (None, Some(user), Some(host)) => format!("{user}@{host}"),
        _ => {
            let text = "it is not known who locks: USER and HOSTNAME are not both set; expected --owner OWNER";
            return Err(UsageError::new(text).into());
        }
    };
    let namespace = options.into.clone().map_or_else(|| mutexes(context), Ok)?;
    Ok(Mutex { namespace, name: name.to_owned(), owner })
}

/// The collection of mutexes, where none is named.
pub(super) fn mutexes(context: &Context<'_>) -> Result<Namespace, NamespaceError> {
    let database = context.settings.shared_databases.value.first().map_or(DATABASE, String::as_str);
    Namespace::parse(&format!("{database}.{COLLECTION}"))
}
