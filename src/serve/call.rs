//! A command that is being run, and its client.

use std::sync::Arc;

use super::access::{Access, Metadata};
use super::request::Request;
use crate::memory::Memory;

/// A command that is being run.
pub(super) struct Call {
    pub(super) request: Request,
    pub(super) metadata: Metadata,
    /// What the client calls itself, for the history.
    pub(super) author: Arc<str>,
}

impl Call {
    /// The memory as the client sees it.
    pub(super) fn access<'m>(&self, memory: &'m Memory) -> Access<'m> {
        Access::new(memory, self.metadata)
    }
}
