//! `rmem unlock NAME`: let go of what was locked.

use super::Context;
use super::lock::mutex;
use crate::cli::Unlock;
use crate::exit::Exit;
use crate::formats::shell;
use crate::memory::lock::Tried;

pub(super) fn run(args: &Unlock, context: &mut Context<'_>) -> anyhow::Result<Exit> {
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
