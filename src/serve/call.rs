//! A command that is being run, and its client.

use std::sync::Arc;

use super::access::{Access, Metadata};
use super::request::Request;
use super::statements::Statements;
use crate::memory::Memory;

/// A command that is being run.
pub(super) struct Call {
    pub(super) request: Arc<Request>,
    pub(super) metadata: Metadata,
    /// What the client calls itself, for the history.
    pub(super) author: Arc<str>,
    /// The statements of a write that may be repeated; without numbers, of any other command.
    pub(super) statements: Arc<Statements>,
}

impl Call {
    /// A command of a client.
    pub(super) fn new(request: Arc<Request>, metadata: Metadata, author: &Arc<str>) -> Self {
        Self { request, metadata, author: Arc::clone(author), statements: Arc::default() }
    }

    /// The memory as the client sees it.
    pub(super) fn access<'m>(&self, memory: &'m Memory) -> Access<'m> {
        Access::new(memory, self.metadata)
    }
}
