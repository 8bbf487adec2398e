//! `rmem clips run` where rmem was built without CLIPS.

use crate::cli::ClipsRun;
use crate::commands::{Context, UsageError};
use crate::exit::Exit;

pub(super) fn run(_: &ClipsRun, _: &mut Context<'_>) -> anyhow::Result<Exit> {
    let text = "this rmem was built without CLIPS inside; build it with --features clips-engine, which wants libclang";
    Err(UsageError::new(text).into())
}
