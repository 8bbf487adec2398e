//! Memory that several runs at once share.

use std::sync::Mutex;

/// A limit of memory over several runs. Each says what it has; where that is too much together, who has most
/// gives way.
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

    /// Notes that the run has so many bytes; says whether it has to give way.
    pub(crate) fn gives_way(&self, bytes: u64) -> bool {
        // What a panicked run noted last is as good as what it would have noted next.
        let mut used = self.pool.used.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(own) = used.get_mut(self.place) {
            *own = bytes;
        }
        let all = used.iter().fold(0, |sum: u64, bytes| sum.saturating_add(*bytes));
        let most = used.iter().enumerate().max_by_key(|(_, bytes)| **bytes).map(|(place, _)| place);
        let gives_way = all > self.pool.limit && most == Some(self.place);
        if gives_way && let Some(own) = used.get_mut(self.place) {
            // What it has is about to be free: nobody else has to go for it.
            *own = 0;
        }
        gives_way
    }

    /// Notes that the run has ended.
    pub(crate) fn release(&self) {
        self.gives_way(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_has_most_gives_way_where_all_have_too_much() {
        let pool = Pool::new(100, 2);
        let (one, other) = (pool.share(0), pool.share(1));
        assert!(!one.gives_way(90));
        assert!(!other.gives_way(20), "the other one has more");
        assert!(one.gives_way(90));
        assert!(!other.gives_way(95), "one is enough");
        one.release();
        assert!(!other.gives_way(100), "what has ended has nothing");
        assert!(other.gives_way(101));
    }
}
