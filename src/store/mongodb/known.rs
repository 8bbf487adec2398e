//! What is known of collections for a while, so that the server is not asked with each operation.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bson::Binary;

use crate::store::Namespace;

/// How long something is taken to be as it was: other clients may drop and make collections and indexes.
const KNOWN_FOR: Duration = Duration::from_secs(1);

/// Which collection has a name.
#[derive(Clone)]
pub(super) enum Identity {
    Known(Binary),
    /// The server does not say, or takes no identity with a write.
    Unknown,
    /// There is none.
    Missing,
}

/// What is known of collections.
pub(super) struct Known<T>(Mutex<HashMap<Namespace, (Instant, T)>>);

impl<T> Default for Known<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T: Clone> Known<T> {
    /// What is known of a collection.
    pub(super) fn get(&self, ns: &Namespace) -> Option<T> {
        let all = self.all();
        all.get(ns).filter(|(learned, _)| learned.elapsed() < KNOWN_FOR).map(|(_, value)| value.clone())
    }

    pub(super) fn learn(&self, ns: &Namespace, value: T) {
        self.all().insert(ns.clone(), (Instant::now(), value));
    }

    pub(super) fn forget(&self, ns: &Namespace) {
        self.all().remove(ns);
    }

    fn all(&self) -> MutexGuard<'_, HashMap<Namespace, (Instant, T)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
