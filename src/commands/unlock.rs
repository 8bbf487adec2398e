//! `rmem unlock NAME`: let go of what was locked.

use bson::doc;
use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::lock::{HolderOptions, collection, mutex};
use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::visible;
use crate::memory::lock::{Tried, release_expired as release};

/// What stands below the help of `unlock`.
const HELP: &str = "\
Examples:
  rmem unlock table --owner r1
  rmem unlock --expired

Exits with 5 if another owner holds the lock, and with 1 if the name is not locked. --expired releases the \
locks whose --ttl is over, whoever their owner was, and prints them; with a NAME, that one. See also rmem help lock.";

/// Release a lock
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct UnlockArgs {
    /// Name of the lock
    #[arg(value_name = "NAME", value_parser = NonEmptyStringValueParser::new(), required_unless_present = "expired")]
    pub name: Option<String>,
    /// Release expired locks of any owner (default: all of them)
    #[arg(long, conflicts_with = "owner")]
    pub expired: bool,
    /// The owner and the collection; shared with `lock`.
    #[command(flatten)]
    pub holder: HolderOptions,
}

pub(super) fn run(args: &UnlockArgs, context: &mut Context<'_>) -> Result<Exit> {
    // The command line has a name, or --expired.
    let Some(name) = args.name.as_ref().filter(|_| !args.expired) else { return release_expired(args, context) };
    let mutex = mutex(name, &args.holder, context)?;
    let memory = context.memory()?;
    match mutex.unlock(&memory)? {
        Tried::Done(document) => {
            context.print_result(document)?;
            Ok(Exit::Done)
        }
        Tried::Held(holder) => {
            context.output.error(&format!(
                "{} is {holder}, not by {}",
                visible::line(name),
                visible::line(&mutex.owner)
            ));
            Ok(Exit::Conflict)
        }
        Tried::Free => {
            context.output.error(&format!("{} is not locked", visible::line(name)));
            Ok(Exit::No)
        }
    }
}

/// Releases expired locks, and prints each with its former owner.
fn release_expired(args: &UnlockArgs, context: &mut Context<'_>) -> Result<Exit> {
    let namespace = collection(&args.holder, context)?;
    let released = release(&context.memory()?, &namespace, args.name.as_deref())?;
    if released.is_empty() {
        context.output.note("no lock has expired");
        return Ok(if args.name.is_some() { Exit::No } else { Exit::Done });
    }
    let row = |(id, holder): &(bson::Bson, crate::memory::lock::Holder)| {
        Ok(doc! { "_id": id, "locked": false, "was-locked-by": &holder.owner, "lock-until": holder.until })
    };
    context.print_rows(released.iter().map(row))?;
    Ok(Exit::Done)
}
