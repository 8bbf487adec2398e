//! `rmem lock NAME`: mutual exclusion between robots.

use std::time::Duration;

use clap::Args;
use clap::builder::NonEmptyStringValueParser;
use rustix::system;

use super::{Context, UsageError, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{quantity, visible};
use crate::memory::lock::{Mutex, Tried};
use crate::store::{Namespace, NamespaceError};

/// What stands below the help of `lock`.
const HELP: &str = "\
Examples:
  rmem lock table --owner r1 --ttl 30s
  rmem lock table --owner r1 --force
  rmem lock table --owner r1 --wait 1m && { pick-up; rmem unlock table --owner r1; }

Exits with 5 if another owner holds the lock. The owner of a lock may lock it again, which renews it (without --ttl, it then has no end): two processes \
with the same owner do not exclude each other. --force takes the lock from another owner, and prints who had it: for \
a lock without --ttl whose robot is gone.

Locks are documents {_id: NAME, locked, \"locked-by\", \"lock-time\", \"lock-until\"} in the collection mutexes of the \
first of shared_databases (default: robmem.mutexes). Their times are those of the store: of the MongoDB primary, or \
of this machine. If that clock is set forward, a lock with --ttl expires earlier; if it is set back, later.";

/// Lock a name, so that no other robot can
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::RESULT))]
pub struct LockArgs {
    /// Name of the lock
    #[arg(value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub name: String,
    /// The owner and the collection; shared with `unlock`.
    #[command(flatten)]
    pub holder: HolderOptions,
    /// Release the lock after this time
    #[arg(long, value_name = "DURATION", value_parser = ttl)]
    pub ttl: Option<Duration>,
    /// Wait at most this long for another owner (default: do not wait)
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub wait: Option<Duration>,
    /// Take the lock even if another owner holds it
    #[arg(long, conflicts_with = "wait")]
    pub force: bool,
}

/// The owner of a lock, and its collection.
#[derive(Debug, Clone, Default, Args)]
pub struct HolderOptions {
    /// Owner of the lock (default: $USER@HOST)
    #[arg(long, value_name = "OWNER", value_parser = NonEmptyStringValueParser::new())]
    pub owner: Option<String>,
    /// Collection of the locks
    #[arg(long, value_name = "NS")]
    pub into: Option<Namespace>,
}

/// The longest time that a lock is held: a hundred years. Dates end some time after.
const MAX_TTL: Duration = Duration::from_secs(36_500 * 86_400);

fn ttl(text: &str) -> Result<Duration, String> {
    match quantity::duration(text)? {
        Duration::ZERO => Err("a lock with --ttl 0s ends at once; expected more than 0s".to_owned()),
        ttl if ttl <= MAX_TTL => Ok(ttl),
        _ => Err(format!("{text} is too long; expected at most 36500d")),
    }
}

/// The collection of mutexes, in its database.
const COLLECTION: &str = "mutexes";
/// The database where none is shared.
const DATABASE: &str = "robmem";

pub(super) fn run(args: &LockArgs, context: &mut Context<'_>) -> Result<Exit> {
    let mutex = mutex(&args.name, &args.holder, context)?;
    let memory = context.memory_to_fill()?;
    if args.force {
        let (former, document) = mutex.force(&memory, args.ttl)?;
        if let Some(former) = former {
            context.output.note(&format!("{} was {former}", visible::line(&args.name)));
        }
        context.print_result(document)?;
        return Ok(Exit::Done);
    }
    match mutex.lock(&memory, args.ttl, args.wait.unwrap_or(Duration::ZERO))? {
        Tried::Done(document) => {
            context.print_result(document)?;
            Ok(Exit::Done)
        }
        Tried::Held(holder) => {
            context.output.error(&format!("{} is {holder}", visible::line(&args.name)));
            Ok(Exit::Conflict)
        }
        Tried::Free => Ok(Exit::Conflict),
    }
}

/// The mutex and its owner.
pub(super) fn mutex(name: &str, options: &HolderOptions, context: &Context<'_>) -> Result<Mutex> {
    let set = |name: &str| context.environment.get(name).filter(|value| !value.is_empty());
    // A shell does not give HOSTNAME to its programs unless it is told to.
    let host = || match set("HOSTNAME") {
        Some(host) => host.clone(),
        None => system::uname().nodename().to_string_lossy().into_owned(),
    };
    let owner = match (&options.owner, set("USER")) {
        (Some(owner), _) => owner.clone(),
        (None, Some(user)) => format!("{user}@{}", host()),
        (None, None) => {
            let text = "the owner is not known: USER is not set; expected --owner OWNER";
            return Err(UsageError::new(text).into());
        }
    };
    let namespace = collection(options, context)?;
    Ok(Mutex { namespace, name: name.to_owned(), owner })
}

/// The collection of mutexes.
pub(super) fn collection(options: &HolderOptions, context: &Context<'_>) -> Result<Namespace, NamespaceError> {
    options.into.clone().map_or_else(|| mutexes(context), Ok)
}

/// The collection of mutexes, where none is named.
pub(super) fn mutexes(context: &Context<'_>) -> Result<Namespace, NamespaceError> {
    let database = context.settings.shared_databases.value.first().map_or(DATABASE, String::as_str);
    Namespace::parse(&format!("{database}.{COLLECTION}"))
}
