//! `rmem man`: the manual page.

use clap::Args;

use super::Context;
use crate::exit::Exit;

/// Print the manual page
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem man > rmem.1")]
pub struct ManArgs {}

pub(super) fn run(_: &ManArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let mut page = Vec::new();
    clap_mangen::Man::new((context.command_line)()).render(&mut page)?;
    context.output.stdout().write_all(&page)?;
    Ok(Exit::Done)
}
