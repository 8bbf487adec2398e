//! A memory that is opened, or lent, by its first use.

use std::cell::OnceCell;
use std::sync::Arc;

use super::failure::{Failure, codes};
use super::pool::Pooled;
use super::server::Server;
use crate::memory::Memory;

/// A memory that is opened, or lent, by its first use.
pub(super) struct Lazy {
    server: Arc<Server>,
    memory: OnceCell<Pooled>,
    source: Source,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    /// One of the thread that writes.
    Writer,
    /// One that connections share.
    Pool,
    /// One beside those.
    Aside,
}

impl Lazy {
    /// A memory of the thread that writes.
    pub(super) fn of_writer(server: &Arc<Server>) -> Self {
        Self::from(server, Source::Writer)
    }

    /// One of those that connections share.
    pub(super) fn lent(server: &Arc<Server>) -> Self {
        Self::from(server, Source::Pool)
    }

    /// One of its own, which is closed after use.
    pub(super) fn aside(server: &Arc<Server>) -> Self {
        Self::from(server, Source::Aside)
    }

    fn from(server: &Arc<Server>, source: Source) -> Self {
        Self { server: Arc::clone(server), memory: OnceCell::new(), source }
    }

    /// The memory, where it was used.
    pub(super) fn opened(&self) -> Option<&Memory> {
        self.memory.get().map(|one| &one.memory)
    }

    pub(super) fn get(&self) -> Result<&Memory, Failure> {
        if self.memory.get().is_none() {
            let memory = match self.source {
                Source::Writer => Pooled { memory: self.server.open()?, share: usize::MAX },
                Source::Pool => self.server.lend()?,
                Source::Aside => self.server.open_one_more()?,
            };
            // The cell is empty: nothing else of this thread can have filled it meanwhile.
            let _ = self.memory.set(memory);
        }
        self.opened().ok_or_else(|| Failure::new(codes::INTERNAL, "the memory is not open"))
    }

    /// Gives back a memory that was lent. One that is dropped instead is closed: after a mistake of rmem's own it is not
    /// lent again.
    pub(super) fn give_back(mut self) {
        if self.source == Source::Pool
            && let Some(memory) = self.memory.take()
        {
            self.server.pool.give(memory);
        }
    }
}

impl Drop for Lazy {
    fn drop(&mut self) {
        if self.source != Source::Writer && self.memory.get().is_some() {
            self.server.pool.lost();
        }
    }
}
