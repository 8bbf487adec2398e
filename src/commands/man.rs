//! `rmem man`: the manual page.

use super::Context;
use crate::cli;
use crate::exit::Exit;

pub(super) fn run(context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let mut page = Vec::new();
    clap_mangen::Man::new(cli::command()).render(&mut page)?;
    context.output.stdout().write_all(&page)?;
    Ok(Exit::Done)
}
