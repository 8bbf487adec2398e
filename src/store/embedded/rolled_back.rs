//! Whether SQLite has rolled back a write while its work goes on.
//!
//! Where the disk is full, or cannot be read or written, SQLite often rolls back the whole transaction and not only the
//! statement that failed. The work may go on, since a step that fails among others fails alone. What it wrote
//! from then on would be transactions of their own, and would stay although the write as a whole has failed.

use std::cell::{Cell, RefCell};

use super::place::Place;
use crate::store::StoreError;

/// The state of the current write transaction.
#[derive(Default)]
pub(super) struct RolledBack {
    /// Whether its work is being done.
    is_writing: Cell<bool>,
    cause: RefCell<Option<Cause>>,
}

/// The error for which it was rolled back.
struct Cause {
    is_full_disk: bool,
    reason: String,
}

impl RolledBack {
    /// Says that the work of a transaction begins.
    pub(super) fn begin(&self) {
        self.is_writing.set(true);
    }

    /// Says that it has ended; gives the error for which it was rolled back meanwhile.
    pub(super) fn end(&self, place: &Place) -> Option<StoreError> {
        let error = self.error(place);
        self.is_writing.set(false);
        self.cause.replace(None);
        error
    }

    pub(super) fn is_writing(&self) -> bool {
        self.is_writing.get()
    }

    /// Notes the error for which the transaction was rolled back; the first one counts.
    pub(super) fn note(&self, error: &StoreError) {
        let (is_full_disk, reason) = match error {
            StoreError::DiskFull { reason, .. } => (true, reason.clone()),
            StoreError::Failed { reason, .. } | StoreError::Unreachable { reason, .. } => (false, reason.clone()),
            other => (false, other.to_string()),
        };
        self.cause.borrow_mut().get_or_insert(Cause { is_full_disk, reason });
    }

    /// The error for which the transaction was rolled back, where it was.
    pub(super) fn error(&self, place: &Place) -> Option<StoreError> {
        let cause = self.cause.borrow();
        let Cause { is_full_disk, reason } = cause.as_ref()?;
        let (address, reason) = (place.to_string(), reason.clone());
        Some(match is_full_disk {
            true => StoreError::DiskFull { address, reason },
            false => StoreError::Failed { address, reason },
        })
    }
}
