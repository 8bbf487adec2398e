//! How old something is that was dated by the system's clock, which may be set forward: a robot without a clock of its own
//! hears the time from others, some while after it has started.
//!
//! Where the clock jumps, what was dated before is as old as it was, for as long as anything is kept that is told by its age
//! ([`LONGEST`]); then nothing is there any more that was dated before the jump.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bson::DateTime;

use crate::saturate::to_i64;

/// A clock that is faster than this is one that was set forward.
const LEAST_JUMP: Duration = Duration::from_secs(30);
/// How long is kept what is told by its age: what writes were answered, longer than a session lives, and than changes of
/// a transaction are kept.
pub(super) const LONGEST: Duration = Duration::from_secs(65 * 60);

/// Tells dates by their age.
#[derive(Debug)]
pub(super) struct Ages(Mutex<Seen>);

/// The clock as it was seen.
#[derive(Debug, Clone, Copy)]
struct Seen {
    date: DateTime,
    at: Instant,
    /// Since when it is ahead of what has passed, and by how many milliseconds.
    jumped: Option<(Instant, i64)>,
}

impl Ages {
    pub(super) fn new() -> Self {
        Self(Mutex::new(Seen { date: DateTime::now(), at: Instant::now(), jumped: None }))
    }

    /// The date of what is so old. To be asked every few seconds.
    pub(super) fn ago(&self, age: Duration) -> DateTime {
        let mut seen = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        minus(seen.look(DateTime::now(), Instant::now()), age)
    }
}

impl Seen {
    /// Looks at the clock; returns the date by which ages are told.
    fn look(&mut self, date: DateTime, at: Instant) -> DateTime {
        let passed = to_i64(at.saturating_duration_since(self.at).as_millis());
        let expected = self.date.timestamp_millis().saturating_add(passed);
        let (ahead, least) = (date.timestamp_millis().saturating_sub(expected), to_i64(LEAST_JUMP.as_millis()));
        if ahead > least {
            // What was dated between two jumps is not older than the second one either.
            let (since, known) = self.jumped.filter(|(_, known)| ahead <= known + least).unwrap_or((at, ahead));
            self.jumped = Some((since, known));
            if at.saturating_duration_since(since) < LONGEST {
                return DateTime::from_millis(expected);
            }
        }
        *self = Self { date, at, jumped: None };
        date
    }
}

fn minus(date: DateTime, age: Duration) -> DateTime {
    DateTime::from_millis(date.timestamp_millis().saturating_sub(to_i64(age.as_millis())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_is_set_forward_makes_nothing_older() {
        let (start, hour) = (Instant::now(), 3_600_000);
        let mut seen = Seen { date: DateTime::from_millis(0), at: start, jumped: None };
        let mut look = |minutes: u64, clock: i64| {
            seen.look(DateTime::from_millis(clock), start + Duration::from_secs(60 * minutes)).timestamp_millis()
        };
        assert_eq!(look(1, 60_000), 60_000);
        assert_eq!(look(2, 2 * hour), 120_000);
        assert_eq!(look(61, 2 * hour + 59 * 60_000), 61 * 60_000);
        // Nothing from before the jump is kept any more.
        assert_eq!(look(68, 3 * hour + 360_000), 3 * hour + 360_000);
        assert_eq!(look(69, 3 * hour + 420_000), 3 * hour + 420_000);
        // Two jumps: what was dated between them is no older than the second one.
        let (minute, base) = (60_000, 3 * hour + 420_000);
        assert_eq!(look(70, 6 * hour), base + minute);
        assert_eq!(look(110, 9 * hour), base + 41 * minute);
        assert_eq!(look(140, 9 * hour + 30 * minute), base + 71 * minute);
        assert_eq!(look(176, 9 * hour + 66 * minute), 9 * hour + 66 * minute);
        // Set back, it makes nothing older either.
        assert_eq!(look(177, 5), 5);
        assert_eq!(look(178, 60_005), 60_005);
    }
}
