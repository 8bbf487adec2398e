//! `rmem exit-codes`: the table of exit codes.

use bson::doc;
use clap::Args;

use super::{Context, formats};
use crate::error::Result;
use crate::exit::{Exit, TABLE};

/// Print the table of exit codes
#[derive(Debug, Args)]
#[command(after_help = help(), arg = formats::argument(&formats::TEXT))]
pub struct ExitCodesArgs {}

pub(super) fn run(_: &ExitCodesArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.print_lines(TABLE.map(|(exit, meaning)| {
        let line = format!("{:>3}  {meaning}", exit.code());
        (line, doc! { "code": i32::from(exit.code()), "meaning": meaning }.into())
    }))?;
    Ok(Exit::Done)
}

/// The table, for `rmem help exit-codes`.
fn help() -> String {
    let codes = TABLE.iter().map(|(exit, meaning)| format!("{:>5}  {meaning}\n", exit.code()));
    format!("Exit codes:\n{}\nExample:\n  rmem help exit-codes", codes.collect::<String>())
}
