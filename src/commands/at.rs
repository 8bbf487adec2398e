//! `--at TIME`: answers from the memory as it was.

use bson::DateTime;
use clap::Args;

use super::Context;
use crate::error::Result;
use crate::formats::quantity;
use crate::memory::Memory;

/// The memory as it was, for commands that read.
#[derive(Debug, Clone, Args)]
pub struct AtArgs {
    /// Read the memory as it was at a time: 14:03:20 (UTC), a date, or 10m for ten minutes ago
    #[arg(long, value_name = "TIME", value_parser = past)]
    pub at: Option<DateTime>,
}

impl AtArgs {
    /// Returns the memory as it is, or as it was.
    pub(super) fn memory(&self, context: &mut Context<'_>) -> Result<Memory> {
        let memory = context.memory()?;
        Ok(match self.at {
            Some(at) => memory.as_of(at)?,
            None => memory,
        })
    }
}

/// Reads a time that is not in the future.
pub(super) fn past(text: &str) -> Result<DateTime, String> {
    let now = DateTime::now();
    let time = quantity::time(text, now)?;
    if time > now { Err(format!("`{text}` is in the future")) } else { Ok(time) }
}
