//! `--computed` and `--strict`: which documents a command reads, and whether their collection has to exist.

use clap::Args;

use super::{Context, missing};
use crate::error::Result;
use crate::memory::Memory;
use crate::store::Namespace;

/// What a command reads of a collection.
#[derive(Debug, Clone, Args)]
pub struct ReadArgs {
    /// Include all that computables have in the cache
    #[arg(long)]
    pub computed: bool,
    /// Fail if the collection does not exist
    #[arg(long)]
    pub strict: bool,
}

impl ReadArgs {
    /// Lets the memory show what was asked for.
    ///
    /// # Errors
    /// Where the collection has to exist, and does not.
    pub(super) fn apply(&self, namespace: &Namespace, memory: &Memory, context: &Context<'_>) -> Result<()> {
        memory.show_computed(self.computed);
        if self.strict {
            missing::refuse(namespace, memory, context)?;
        }
        Ok(())
    }
}
