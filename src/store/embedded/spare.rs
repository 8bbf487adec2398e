//! A second store on the file, for a thread that reads ahead. It is kept between scans with the pages that it has read.

use std::sync::{Arc, Mutex, PoisonError};

/// The store, where it is open and not lent.
pub(super) struct Spare<T>(Arc<Mutex<Option<Box<T>>>>);

/// The store as it is lent; given back when dropped.
pub(super) struct Lent<T> {
    store: Option<Box<T>>,
    home: Arc<Mutex<Option<Box<T>>>>,
}

impl<T> Default for Spare<T> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<T> Spare<T> {
    /// Lends the store, which `open` makes where there is none.
    pub(super) fn lend(&self, open: impl FnOnce() -> Option<T>) -> Option<Lent<T>> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        let store = kept.or_else(|| open().map(Box::new))?;
        Some(Lent { store: Some(store), home: Arc::clone(&self.0) })
    }
}

impl<T> Lent<T> {
    pub(super) fn store(&self) -> Option<&T> {
        self.store.as_deref()
    }
}

impl<T> Drop for Lent<T> {
    fn drop(&mut self) {
        *self.home.lock().unwrap_or_else(PoisonError::into_inner) = self.store.take();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_lent_is_lent_again() {
        let spare = Spare::default();
        let one = spare.lend(|| Some(1)).unwrap();
        let two = spare.lend(|| Some(2)).unwrap();
        assert_eq!((one.store(), two.store()), (Some(&1), Some(&2)));
        assert!(spare.lend(|| None).is_none());
        drop(two);
        assert_eq!(spare.lend(|| None).unwrap().store(), Some(&2));
    }
}
