//! What ends a run.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Whether a run has to end; can be asked from any thread.
#[derive(Debug)]
pub(super) struct Stop {
    interrupted: &'static AtomicBool,
    deadline: Option<Instant>,
    exited: AtomicBool,
}

impl Stop {
    pub(super) fn new(interrupted: &'static AtomicBool, deadline: Option<Instant>) -> Self {
        Self { interrupted, deadline, exited: AtomicBool::new(false) }
    }

    /// The program wants to end.
    pub(super) fn exit(&self) {
        self.exited.store(true, Ordering::Relaxed);
    }

    /// Whether the run was interrupted.
    pub(super) fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Whether the time is over.
    pub(super) fn is_over(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Whether anything of this is so.
    pub(super) fn is_due(&self) -> bool {
        self.exited.load(Ordering::Relaxed) || self.is_interrupted() || self.is_over()
    }

    /// When the time will be over.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.deadline
    }
}
