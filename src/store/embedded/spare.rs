//! A second connection to the file, for a thread that reads ahead. It is kept between scans with the pages that it has read.

use std::sync::{Arc, Mutex, PoisonError};

use super::Embedded;

/// The connection, where it is open and not lent.
#[derive(Default, Clone)]
pub(super) struct Spare(Arc<Mutex<Option<Box<Embedded>>>>);

/// The connection as it is lent; given back when dropped.
pub(super) struct Lent {
    store: Option<Box<Embedded>>,
    home: Spare,
}

impl Spare {
    /// Lends the connection, which `open` makes where there is none.
    pub(super) fn lend(&self, open: impl FnOnce() -> Option<Embedded>) -> Option<Lent> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        let store = kept.or_else(|| open().map(Box::new))?;
        Some(Lent { store: Some(store), home: self.clone() })
    }
}

impl Lent {
    pub(super) fn store(&self) -> Option<&Embedded> {
        self.store.as_deref()
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        *self.home.0.lock().unwrap_or_else(PoisonError::into_inner) = self.store.take();
    }
}
