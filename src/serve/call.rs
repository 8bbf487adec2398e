//! A command that is being run, and its client.

use super::access::{Access, Metadata};
use super::request::Request;
use crate::memory::Memory;

/// A command that is being run.
pub(super) struct Call {
    pub(super) request: Request,
    pub(super) metadata: Metadata,
}

impl Call {
    /// The memory as the client sees it.
    pub(super) fn access<'m>(&self, memory: &'m Memory) -> Access<'m> {
        Access::new(memory, self.metadata)
    }
}
