//! `rmem exit-codes`: the table of exit codes.

use clap::Args;

use super::Context;
use crate::exit::{Exit, TABLE};

/// Print the table of exit codes
#[derive(Debug, Args)]
#[command(after_help = help())]
pub struct ExitCodesArgs {}

pub(super) fn run(_: &ExitCodesArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    for (exit, meaning) in TABLE {
        context.output.line(&format!("{:>3}  {meaning}", exit.code()))?;
    }
    Ok(Exit::Done)
}

/// The table, for `rmem help exit-codes`.
fn help() -> String {
    let codes = TABLE.iter().map(|(exit, meaning)| format!("{:>5}  {meaning}\n", exit.code()));
    format!("Exit codes:\n{}\nExample:\n  rmem help exit-codes", codes.collect::<String>())
}
