//! `rmem lock NAME`: mutual exclusion between robots.

use std::time::Duration;

use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::{Context, UsageError};
use crate::exit::Exit;
use crate::formats::{quantity, shell};
use crate::memory::lock::{Mutex, Tried};
use crate::store::{Namespace, NamespaceError};

/// Lock a name, so that no other robot does
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem lock table --owner r1 --ttl 30s\n  rmem lock table --owner r1 --wait 1m && { pick-up; rmem unlock table --owner r1; }\n\n\
The owner who holds the lock may lock again, which renews it. Where it is held by another,\n\
exits with 5. Without --owner it is $USER@$HOSTNAME from the environment, and where these are\n\
not set, it has to be given; two processes with one owner do not exclude each other. Locks\n\
are documents {_id: NAME, locked, \"locked-by\", \"lock-time\", \"lock-until\"} in the collection\n\
mutexes of the first of shared_databases, or of robmem where none is shared. Times are those of the\n\
store: on MongoDB the primary's clock, in a file this machine's. Where that clock is set forward, a lock\n\
with --ttl expires earlier; where it is set back, later, by as much as the clock jumped."
)]
pub struct LockArgs {
    /// What is locked
    #[arg(value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub name: String,
    /// Who locks and where; shared with `unlock`.
    #[command(flatten)]
    pub holder: HolderOptions,
    /// The lock expires after so long
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub ttl: Option<Duration>,
    /// Wait so long for whoever holds it
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub wait: Option<Duration>,
}

/// Who locks, and in which collection.
#[derive(Debug, Clone, Default, Args)]
pub struct HolderOptions {
    /// Who holds the lock
    #[arg(long, value_name = "OWNER", value_parser = NonEmptyStringValueParser::new())]
    pub owner: Option<String>,
    /// The collection of locks
    #[arg(long, value_name = "NS")]
    pub into: Option<Namespace>,
}

/// The collection of mutexes, in its database.
const COLLECTION: &str = "mutexes";
/// The database where none is shared.
const DATABASE: &str = "robmem";

pub(super) fn run(args: &LockArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
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
