//! `rmem exit-codes`: the table of exit codes.

use super::Context;
use crate::exit::{Exit, TABLE};

pub(super) fn run(context: &mut Context<'_>) -> anyhow::Result<Exit> {
    for (exit, meaning) in TABLE {
        context.output.line(&format!("{:>3}  {meaning}", exit.code()))?;
    }
    Ok(Exit::Done)
}
