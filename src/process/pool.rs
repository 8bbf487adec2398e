//! A limit of memory that several runs share.

use std::sync::Mutex;

/// A limit of memory over several runs. Each run reports its use; where the sum is over the limit, the run with the most
/// is stopped.
#[derive(Debug)]
pub(crate) struct Pool {
    limit: u64,
    used: Mutex<Vec<u64>>,
}

/// One run's part in a pool.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Share<'a> {
    pool: &'a Pool,
    place: usize,
}

impl Pool {
    /// A pool of `limit` bytes for so many runs.
    pub(crate) fn new(limit: u64, runs: usize) -> Self {
        Self { limit, used: Mutex::new(vec![0; runs]) }
    }

    /// The part of the run at a place.
    pub(crate) fn share(&self, place: usize) -> Share<'_> {
        Share { pool: self, place }
    }
}

impl Share<'_> {
    /// How many bytes all runs may have together.
    pub(crate) fn limit(&self) -> u64 {
        self.pool.limit
    }

    /// Records that the run has so many bytes; returns whether it has to stop.
    pub(crate) fn has_to_stop(&self, bytes: u64) -> bool {
        // After a panic the last recorded sizes are still good.
        let mut used = self.pool.used.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(own) = used.get_mut(self.place) {
            *own = bytes;
        }
        let all = used.iter().fold(0, |sum: u64, bytes| sum.saturating_add(*bytes));
        let most = used.iter().enumerate().max_by_key(|(_, bytes)| **bytes).map(|(place, _)| place);
        let has_to_stop = all > self.pool.limit && most == Some(self.place);
        if has_to_stop && let Some(own) = used.get_mut(self.place) {
            // Its memory is about to be free: no other run has to stop for it.
            *own = 0;
        }
        has_to_stop
    }

    /// Records that the run has ended.
    pub(crate) fn release(&self) {
        self.has_to_stop(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_run_stops_where_all_together_are_over_the_limit() {
        let pool = Pool::new(100, 2);
        let (one, other) = (pool.share(0), pool.share(1));
        assert!(!one.has_to_stop(90));
        assert!(!other.has_to_stop(20), "the other one has more");
        assert!(one.has_to_stop(90));
        assert!(!other.has_to_stop(95), "one is enough");
        one.release();
        assert!(!other.has_to_stop(100), "what has ended has nothing");
        assert!(other.has_to_stop(101));
    }
}
