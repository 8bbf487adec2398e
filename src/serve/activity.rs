//! What connections are doing: one operation each at a time, which others may list and stop.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::request::Request;

/// What a connection is doing.
#[derive(Debug, Default)]
pub(super) struct Activity(Mutex<Option<Arc<Request>>>);

impl Activity {
    /// Begins an operation, which ends when what is returned is dropped.
    pub(super) fn begin(&self, request: &Arc<Request>) -> Active<'_> {
        *self.lock() = Some(Arc::clone(request));
        Active(self)
    }

    /// The operation that runs.
    pub(super) fn current(&self) -> Option<Arc<Request>> {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, Option<Arc<Request>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An operation that runs.
pub(super) struct Active<'a>(&'a Activity);

impl Drop for Active<'_> {
    fn drop(&mut self) {
        *self.0.lock() = None;
    }
}
