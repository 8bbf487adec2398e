//! What is kept of changes, for the streams that are open and those that come back.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::memory::Memory;
use crate::store::{Kept, Scope, StoreError};

/// How long changes are kept: so long a client may be away.
const AGE: Duration = Duration::from_secs(3600);

/// The scopes whose changes are kept, and when a stream read them last.
#[derive(Default)]
pub(in crate::serve) struct Scopes(Mutex<HashMap<Scope, Instant>>);

impl Scopes {
    /// Keeps the changes of a scope from now on.
    pub(in crate::serve) fn keep(&self, memory: &Memory, scope: &Scope) -> Result<Kept, StoreError> {
        let kept = memory.keep_changes(scope, AGE)?;
        self.touch(scope);
        Ok(kept)
    }

    /// Notes that a stream reads a scope.
    pub(in crate::serve) fn touch(&self, scope: &Scope) {
        self.lock().insert(scope.clone(), Instant::now());
    }

    /// Lets go of what is old, also of what an earlier server has kept.
    pub(in crate::serve) fn look_after(&self, memory: &Memory) -> Result<(), StoreError> {
        for scope in memory.kept_scopes()? {
            let used = *self.lock().entry(scope.clone()).or_insert_with(Instant::now);
            if used.elapsed() < AGE {
                memory.keep_changes(&scope, AGE)?;
            } else {
                memory.release_changes(&scope)?;
                self.lock().remove(&scope);
            }
        }
        Ok(())
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Scope, Instant>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
