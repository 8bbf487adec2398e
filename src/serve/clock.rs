//! Times of operations as MongoDB writes them: seconds, and a count within the second.
//!
//! The count is the milliseconds times [`PER_MILLISECOND`], and within the millisecond the number of the change, which grows,
//! times [`PER_CHANGE`]: between two changes others write of whose changes nothing is kept.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use bson::{DateTime, Timestamp};

use crate::monotonic;

/// So many times are within a millisecond: with those of a second, nearly all that 32 bits can count.
const PER_MILLISECOND: u32 = 4_000_000;
/// So many times are from a change to the next.
const PER_CHANGE: i64 = 10;

/// How often it is looked whether a write is durable.
const SETTLE_INTERVAL: Duration = Duration::from_micros(200);

/// Gives times that do not go back.
#[derive(Debug, Default)]
pub(super) struct Clock {
    last: AtomicU64,
    /// When a client wrote last.
    written: AtomicU64,
    /// When each write began that is not durable yet.
    writing: Mutex<Vec<u64>>,
}

impl Clock {
    /// The time.
    pub(super) fn now(&self) -> Timestamp {
        let now = packed(of(monotonic::now(), 0));
        unpacked(self.last.fetch_max(now, Ordering::Relaxed).max(now))
    }

    /// The time up to which all changes can be read: a change that becomes durable from now on has no earlier one.
    /// Those of other processes, those in slices, and what expires, may.
    pub(super) fn settled(&self) -> Timestamp {
        let now = packed(self.now());
        unpacked(self.writing().iter().copied().min().map_or(now, |began| began.min(now)))
    }

    /// The time, later than all that were given, when all changes up to it can be read; where a write takes longer than `limit`,
    /// the time when that began.
    pub(super) fn settled_tick(&self, limit: Duration) -> Timestamp {
        let (time, since) = (self.tick(), Instant::now());
        loop {
            let settled = self.settled();
            if packed(settled) >= packed(time) {
                return time;
            }
            if since.elapsed() >= limit {
                return settled;
            }
            thread::sleep(SETTLE_INTERVAL);
        }
    }

    /// Notes that a write begins, until its changes are durable.
    pub(super) fn begin_write(&self) -> Writing<'_> {
        let mut writing = self.writing();
        let began = packed(self.now());
        writing.push(began);
        Writing { clock: self, began }
    }

    fn writing(&self) -> MutexGuard<'_, Vec<u64>> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The time, later than all that were given.
    pub(super) fn tick(&self) -> Timestamp {
        let now = packed(of(monotonic::now(), 0));
        let last = self.last.fetch_max(now, Ordering::Relaxed);
        if now > last {
            return unpacked(now);
        }
        unpacked(self.last.fetch_add(1, Ordering::Relaxed) + 1)
    }

    /// Notes that a client has written, and returns when: at the time of its last change, where that is kept.
    pub(super) fn wrote(&self, change: Option<Timestamp>) -> Timestamp {
        let time = change.unwrap_or_else(|| {
            let time = self.now();
            // What is told from now on is later than a write of which nothing is kept.
            self.tick();
            time
        });
        self.last.fetch_max(packed(time), Ordering::Relaxed);
        self.written.fetch_max(packed(time), Ordering::Relaxed);
        time
    }

    /// Whether a time was told already, or a later one: a change may not have it.
    pub(super) fn has_told(&self, time: Timestamp) -> bool {
        packed(time) <= self.last.load(Ordering::Relaxed)
    }

    /// Makes what is changed from now on later than all times that were told.
    pub(super) fn move_on(&self) {
        let last = date(unpacked(self.last.load(Ordering::Relaxed)));
        monotonic::advance(DateTime::from_millis(last.timestamp_millis().saturating_add(1)));
    }

    /// When a client wrote last; none where none has.
    pub(super) fn written(&self) -> Option<Timestamp> {
        Some(self.written.load(Ordering::Relaxed)).filter(|time| *time > 0).map(unpacked)
    }
}

/// Whether a time was counted as here, and not by a MongoDB server, whose count within a second is that of its changes.
pub(super) fn is_counted(time: Timestamp) -> bool {
    time.increment >= PER_MILLISECOND
}

/// A write whose changes may not be durable yet.
#[must_use]
pub(super) struct Writing<'a> {
    clock: &'a Clock,
    began: u64,
}

impl Drop for Writing<'_> {
    fn drop(&mut self) {
        let mut writing = self.clock.writing();
        if let Some(index) = writing.iter().position(|began| *began == self.began) {
            writing.swap_remove(index);
        }
    }
}

/// The time of the change with a number.
pub(super) fn of(time: DateTime, number: i64) -> Timestamp {
    let millis = time.timestamp_millis();
    let per_millisecond = i64::from(PER_MILLISECOND);
    let within = number.rem_euclid(per_millisecond / PER_CHANGE - 1) * PER_CHANGE + 1;
    let part = millis.rem_euclid(1000) * per_millisecond + within;
    let (time, increment) = (u32::try_from(millis.div_euclid(1000)), u32::try_from(part));
    Timestamp { time: time.unwrap_or(u32::MAX), increment: increment.unwrap_or(u32::MAX) }
}

/// The date of a time, to the millisecond.
pub(super) fn date(time: Timestamp) -> DateTime {
    let millis = i64::from(time.time) * 1000 + i64::from(time.increment.saturating_sub(1) / PER_MILLISECOND).min(999);
    DateTime::from_millis(millis)
}

/// A time as one number.
pub(super) fn packed(time: Timestamp) -> u64 {
    u64::from(time.time) << 32 | u64::from(time.increment)
}

fn unpacked(time: u64) -> Timestamp {
    let [time, increment] = [time >> 32, time & 0xFFFF_FFFF].map(|half| u32::try_from(half).unwrap_or(u32::MAX));
    Timestamp { time, increment }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_grow() {
        let clock = Clock::default();
        let times: Vec<u64> = (0..1000).map(|_| packed(clock.tick())).collect();
        assert!(times.is_sorted_by(|a, b| a < b));
    }

    #[test]
    fn a_change_is_later_than_what_was_told_before_it() {
        let clock = Clock::default();
        let change = |number| of(monotonic::now(), number);
        for number in 0..20 {
            // Others write, of whose changes nothing is kept.
            let told = (0..number).map(|_| clock.wrote(None)).last().unwrap_or(clock.now()).max(clock.now());
            if clock.has_told(change(number)) {
                clock.move_on();
            }
            let time = change(number);
            assert!(time > told && !clock.has_told(time), "{number}");
            assert_eq!((clock.wrote(Some(time)), clock.now() >= time), (time, true));
        }
    }

    #[test]
    fn what_is_being_written_is_not_earlier_than_what_is_settled() {
        let clock = Clock::default();
        let (told, first) = (clock.settled(), clock.begin_write());
        let change = of(monotonic::now(), 1);
        let (tick, second) = (clock.tick(), clock.begin_write());
        let settled = clock.settled();
        assert!(told <= settled && settled < change && settled < tick, "{told} {settled} {change} {tick}");
        drop(first);
        assert!(clock.settled() >= tick);
        let later = clock.tick();
        assert!(clock.settled() < later);
        drop(second);
        assert!(clock.settled() >= later);
    }

    #[test]
    fn later_changes_have_later_times() {
        let time = |number| packed(of(DateTime::from_millis(1_700_000_000_999), number));
        let times: Vec<u64> = (900_000..903_000).map(time).collect();
        assert!(times.is_sorted_by(|a, b| a < b));
    }

    #[test]
    fn a_date_is_kept_to_the_millisecond() {
        for millis in [0, 1, 999, 1_700_000_000_123] {
            assert_eq!(date(of(DateTime::from_millis(millis), 12_345)).timestamp_millis(), millis);
        }
    }
}
