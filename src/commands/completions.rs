//! `rmem completions SHELL`: a completion script.

use super::Context;
use crate::cli::{self, Completions};
use crate::exit::Exit;

pub(super) fn run(args: &Completions, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut cli::command(), "rmem", &mut script);
    context.output.stdout().write_all(&script)?;
    Ok(Exit::Done)
}
