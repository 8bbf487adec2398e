//! `rmem clips run` where rmem was built without CLIPS.

use super::args::RunArgs;
use crate::commands::{Context, UsageError};
use crate::error::Result;
use crate::exit::Exit;

pub(in crate::commands::clips) fn run(_: &RunArgs, _: &mut Context<'_>) -> Result<Exit> {
    let text = "this rmem was built without CLIPS inside; build it with --features clips-engine, which wants libclang";
    Err(UsageError::new(text).into())
}
