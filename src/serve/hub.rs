//! Notifies threads that wait for changes.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A count that grows with each call, and the threads that wait for it to grow.
#[derive(Debug, Default)]
pub(super) struct Hub {
    calls: Mutex<u64>,
    called: Condvar,
}

impl Hub {
    /// How often was called.
    pub(super) fn calls(&self) -> u64 {
        *self.lock()
    }

    /// Notifies all waiting threads.
    pub(super) fn call(&self) {
        *self.lock() += 1;
        self.called.notify_all();
    }

    /// Waits until there were more calls than so many, for at most `limit`.
    pub(super) fn wait(&self, calls: u64, limit: Duration) {
        let waited = self.called.wait_timeout_while(self.lock(), limit, |now| *now <= calls);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }

    fn lock(&self) -> MutexGuard<'_, u64> {
        self.calls.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn a_call_ends_a_wait_also_where_it_came_before() {
        let hub = Arc::new(Hub::default());
        let calls = hub.calls();
        hub.call();
        hub.wait(calls, Duration::from_secs(3600));
        let (waiting, calls) = (Arc::clone(&hub), hub.calls());
        let waiter = std::thread::spawn(move || waiting.wait(calls, Duration::from_secs(3600)));
        hub.call();
        waiter.join().unwrap();
        hub.wait(hub.calls(), Duration::from_millis(1));
    }
}
