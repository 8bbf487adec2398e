//! What is kept of changes, for the streams that are open and those that come back.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bson::Timestamp;

use crate::memory::Memory;
use crate::serve::age::Ages;
use crate::serve::clock;
use crate::store::{Kept, Scope, StoreError};

/// How long changes are kept: a client that was away for no longer can resume its change stream.
const RETENTION: Duration = Duration::from_secs(3600);

/// The scopes whose changes are kept.
#[derive(Default)]
pub(in crate::serve) struct Scopes(Mutex<HashMap<Scope, Watched>>);

/// A scope whose changes are kept.
struct Watched {
    /// When a stream read it last.
    used: Instant,
    /// No change after this time is missing, but the one at it is; none where an earlier server began to keep them.
    since: Option<Timestamp>,
}

impl Watched {
    fn since(since: Option<Timestamp>) -> Self {
        Self { used: Instant::now(), since }
    }
}

impl Scopes {
    /// Keeps the changes of a scope from now on; the last one before was at `written`.
    pub(in crate::serve) fn keep(
        &self,
        memory: &Memory,
        scope: &Scope,
        written: Timestamp,
        ages: &Ages,
    ) -> Result<Kept, StoreError> {
        let kept = memory.keep_changes(scope, ages.ago(RETENTION))?;
        match kept.is_new {
            true => drop(self.lock().insert(scope.clone(), Watched::since(Some(written)))),
            false => self.touch(scope),
        }
        Ok(kept)
    }

    /// Whether changes of a scope at or after a time may be missing: they were not kept yet, or are not kept any more.
    pub(in crate::serve) fn may_have_lost(&self, scope: &Scope, time: Timestamp, ages: &Ages) -> bool {
        let since = self.lock().get(scope).and_then(|watched| watched.since);
        since.is_some_and(|since| time <= since) || clock::date(time) < ages.ago(RETENTION)
    }

    /// Notes that a stream reads a scope.
    pub(in crate::serve) fn touch(&self, scope: &Scope) {
        self.lock().entry(scope.clone()).or_insert_with(|| Watched::since(None)).used = Instant::now();
    }

    /// Lets go of what is old, also of what an earlier server has kept.
    pub(in crate::serve) fn look_after(&self, memory: &Memory, ages: &Ages) -> Result<(), StoreError> {
        for scope in memory.kept_scopes()? {
            let used = self.lock().entry(scope.clone()).or_insert_with(|| Watched::since(None)).used;
            if used.elapsed() < RETENTION {
                memory.keep_changes(&scope, ages.ago(RETENTION))?;
            } else {
                memory.release_changes(&scope)?;
                self.lock().remove(&scope);
            }
        }
        Ok(())
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Scope, Watched>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
