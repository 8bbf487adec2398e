//! `rmem unlock NAME`: let go of what was locked.

use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::Context;
use super::lock::{HolderOptions, mutex};
use crate::exit::Exit;
use crate::formats::shell;
use crate::memory::lock::Tried;

/// Unlock a name
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  rmem unlock table --owner r1\n\nExits with 5 where another owner holds it, with 1 where nobody does. About --owner, see rmem help lock."
)]
pub struct UnlockArgs {
    /// What is unlocked
    #[arg(value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub name: String,
    /// Who unlocks and where; shared with `lock`.
    #[command(flatten)]
    pub holder: HolderOptions,
}

pub(super) fn run(args: &UnlockArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let mutex = mutex(&args.name, &args.holder, context)?;
    let memory = context.memory()?;
    match mutex.unlock(&memory)? {
        Tried::Done(document) => {
            context.output.line(&shell::relaxed(&document))?;
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
