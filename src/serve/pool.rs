//! The memories of the connections: each is lent for a command, and for as long as its cursors are read.
//!
//! A find takes a few microseconds where the pages of the file, SQLite's statements and what is known of the
//! collection were used just before, and many times that where they were not. So there are as many memories as
//! commands that are worked at at once, not as many as clients, and the one that came back last is lent first.

use std::ops::RangeInclusive;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::memory::Memory;

/// A memory that was not lent for so long keeps nothing of what it has read, …
const COLD: Duration = Duration::from_secs(10);
/// … and after so long, it is closed, unless it is the last one.
const CLOSED: Duration = Duration::from_secs(60);

/// How many bytes a memory keeps of what it has read, at most and at least; the system keeps the rest for all.
const CACHE: RangeInclusive<usize> = 128 << 10..=8 << 20;
/// How many bytes the next memory keeps, with those that there are: many keep some four times as much together.
const CACHES: usize = 32 << 20;

/// The memories that are not lent.
#[derive(Default)]
pub(super) struct Pool {
    /// The one that came back last is the last.
    idle: Mutex<Vec<Idle>>,
    /// How many there are, with those that are lent.
    open: AtomicUsize,
}

/// A memory, and how many bytes it may keep of what it reads.
pub(super) struct Pooled {
    pub(super) memory: Memory,
    pub(super) share: usize,
}

struct Idle {
    pooled: Pooled,
    since: Instant,
    is_warm: bool,
}

impl Pool {
    /// Whether one was not lent for long.
    pub(super) fn has_cold(&self, now: Instant) -> bool {
        let idle = self.lock();
        let is_cold = |one: &Idle| now.saturating_duration_since(one.since) >= COLD;
        idle.first().is_some_and(|one| is_cold(one) && (one.is_warm || idle.len() > 1))
    }

    /// Frees and closes what was not lent for long. Others are lent meanwhile.
    pub(super) fn tidy(&self, now: Instant) {
        let unused = |one: &Idle| now.saturating_duration_since(one.since);
        let mut old: Vec<Idle> = {
            let mut idle = self.lock();
            let cold = idle.iter().take_while(|one| unused(one) >= COLD).count();
            idle.drain(..cold).collect()
        };
        let is_last = old.len() == self.open.load(Ordering::Relaxed);
        let closed = old.iter().take_while(|one| unused(one) >= CLOSED).count().min(old.len() - usize::from(is_last));
        old.drain(..closed).for_each(|_| self.lost());
        for one in old.iter_mut().filter(|one| one.is_warm) {
            one.pooled.memory.free_caches();
            one.is_warm = false;
        }
        // In front of those that came back meanwhile.
        self.lock().splice(..0, old);
    }

    /// The memory that came back last; its share of the caches grows where others were closed.
    pub(super) fn take(&self) -> Option<Pooled> {
        let Pooled { memory, mut share } = self.lock().pop()?.pooled;
        if share < self.share() {
            share = self.share();
            // With a smaller one it works as well.
            let _ = memory.limit_caches(share);
        }
        Some(Pooled { memory, share })
    }

    /// Counts one that was opened; says how many bytes it may keep of what it reads.
    pub(super) fn opened(&self) -> usize {
        self.open.fetch_add(1, Ordering::Relaxed);
        self.share()
    }

    fn share(&self) -> usize {
        (CACHES / self.open.load(Ordering::Relaxed).max(1)).clamp(*CACHE.start(), *CACHE.end())
    }

    /// Takes one back.
    pub(super) fn give(&self, pooled: Pooled) {
        self.lock().push(Idle { pooled, since: Instant::now(), is_warm: true });
    }

    /// One does not come back.
    pub(super) fn lost(&self) {
        self.open.fetch_sub(1, Ordering::Relaxed);
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Idle>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::StoreUri;

    /// Gives as many memories to a pool.
    fn filled(count: usize) -> Pool {
        let pool = Pool::default();
        for _ in 0..count {
            let uri = StoreUri::parse("mem:").unwrap();
            let share = pool.opened();
            pool.give(Pooled { memory: Memory::at(uri.clone(), uri, Vec::new()), share });
        }
        pool
    }

    fn idle(pool: &Pool) -> usize {
        pool.lock().len()
    }

    #[test]
    fn memories_that_were_not_lent_for_long_are_closed_but_for_the_last() {
        let (pool, now) = (filled(3), Instant::now());
        pool.tidy(now + COLD);
        assert_eq!((idle(&pool), pool.lock().iter().any(|one| one.is_warm)), (3, false));
        // What is lent meanwhile stays.
        let lent = pool.take().unwrap();
        pool.tidy(now + CLOSED);
        assert_eq!((idle(&pool), pool.open.load(Ordering::Relaxed)), (0, 1));
        pool.give(lent);
        pool.tidy(now + COLD / 2);
        assert!(pool.lock().iter().all(|one| one.is_warm));
        assert!(!pool.has_cold(now + COLD / 2) && pool.has_cold(now + CLOSED * 2));
        pool.tidy(now + CLOSED * 2);
        assert!(!pool.has_cold(now + CLOSED * 2));
        assert_eq!((idle(&pool), pool.open.load(Ordering::Relaxed)), (1, 1));
        assert!(pool.take().is_some() && pool.take().is_none());
    }

    #[test]
    fn the_more_there_are_the_less_each_keeps() {
        let pool = Pool::default();
        let kept: Vec<usize> = (0..1000).map(|_| pool.opened()).collect();
        assert!(kept.is_sorted_by(|a, b| a >= b));
        assert_eq!((kept[0], kept[999]), (*CACHE.end(), *CACHE.start()));
        assert!(kept[..64].iter().sum::<usize>() < 160 << 20 && kept.iter().sum::<usize>() < 256 << 20);
        pool.lost();
        assert_eq!(pool.open.load(Ordering::Relaxed), 999);
        // One that has little gets more when it is lent again.
        let pool = filled(1000);
        (0..998).for_each(|_| pool.lost());
        assert_eq!(pool.take().map(|one| one.share), Some(*CACHE.end()));
    }
}
