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

struct Idle {
    memory: Memory,
    since: Instant,
    is_warm: bool,
}

impl Pool {
    /// Frees and closes what was not lent for long.
    pub(super) fn tidy(&self, now: Instant) {
        let mut idle = self.lock();
        let unused = |one: &Idle| now.saturating_duration_since(one.since);
        let last = idle.pop();
        let old = idle.iter().take_while(|one| unused(one) >= CLOSED).count();
        let closed: Vec<Idle> = idle.drain(..old).collect();
        idle.extend(last);
        for one in idle.iter_mut().filter(|one| one.is_warm && unused(one) >= COLD) {
            one.memory.free_caches();
            one.is_warm = false;
        }
        closed.iter().for_each(|_| self.lost());
        drop(idle);
        // It takes a while, during which others are lent.
        drop(closed);
    }

    /// The memory that came back last.
    pub(super) fn take(&self) -> Option<Memory> {
        self.lock().pop().map(|one| one.memory)
    }

    /// Counts one that was opened; says how many bytes it may keep of what it reads.
    pub(super) fn opened(&self) -> usize {
        let open = self.open.fetch_add(1, Ordering::Relaxed) + 1;
        (CACHES / open).clamp(*CACHE.start(), *CACHE.end())
    }

    /// Takes one back.
    pub(super) fn give(&self, memory: Memory) {
        self.lock().push(Idle { memory, since: Instant::now(), is_warm: true });
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
            pool.opened();
            pool.give(Memory::at(uri.clone(), uri, Vec::new()));
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
        assert_eq!(idle(&pool), 1);
        pool.give(lent);
        pool.tidy(now + COLD / 2);
        assert_eq!(pool.lock().iter().map(|one| one.is_warm).collect::<Vec<_>>(), [false, true]);
        pool.tidy(now + CLOSED * 2);
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
    }
}
