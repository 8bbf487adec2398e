//! `rmem unlock NAME`: let go of what was locked.

use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::lock::{HolderOptions, mutex};
use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::memory::lock::Tried;

/// What stands below the help of `unlock`.
const HELP: &str = "\
Example:
  rmem unlock table --owner r1

Exits with 5 if another owner holds the lock, and with 1 if the name is not locked. See also rmem help lock.";

/// Release a lock
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::RESULT))]
pub struct UnlockArgs {
    /// Name of the lock
    #[arg(value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub name: String,
    /// The owner and the collection; shared with `lock`.
    #[command(flatten)]
    pub holder: HolderOptions,
}

pub(super) fn run(args: &UnlockArgs, context: &mut Context<'_>) -> Result<Exit> {
    let mutex = mutex(&args.name, &args.holder, context)?;
    let memory = context.memory()?;
    match mutex.unlock(&memory)? {
        Tried::Done(document) => {
            context.print_result(document)?;
            Ok(Exit::Done)
        }
        Tried::Held(holder) => {
            context.output.error(&format!("{} is {holder}, not by {}", args.name, mutex.owner));
            Ok(Exit::Conflict)
        }
        Tried::Free => {
            context.output.error(&format!("{} is not locked", args.name));
            Ok(Exit::No)
        }
    }
}
