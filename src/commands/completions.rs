//! `rmem completions SHELL`: a completion script.

use clap::Args;

use super::Context;
use crate::error::Result;
use crate::exit::Exit;

/// Print a completion script for a shell
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem completions bash > ~/.local/share/bash-completion/completions/rmem")]
pub struct CompletionsArgs {
    /// Shell: bash, elvish, fish, powershell or zsh
    #[arg(value_name = "SHELL", hide_possible_values = true)]
    pub shell: clap_complete::Shell,
}

pub(super) fn run(args: &CompletionsArgs, context: &mut Context<'_>) -> Result<Exit> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut (context.command_line)(), "rmem", &mut script);
    context.output.stdout().write_all(&script)?;
    Ok(Exit::Done)
}
