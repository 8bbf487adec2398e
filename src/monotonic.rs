//! The time of day as this process tells it: where the system's clock is set back, it stays, until that has caught up.

use std::sync::atomic::{AtomicI64, Ordering};

use bson::DateTime;

static LAST: AtomicI64 = AtomicI64::new(i64::MIN);

/// Returns the time, no earlier than any that was returned before.
pub(crate) fn now() -> DateTime {
    later(&LAST, DateTime::now())
}

/// Whether the system's clock is behind the time.
#[cfg(feature = "serve")]
pub(crate) fn is_ahead() -> bool {
    DateTime::now().timestamp_millis() < LAST.load(Ordering::Relaxed)
}

/// From now on the time is no earlier than this.
#[cfg(feature = "serve")]
pub(crate) fn advance(time: DateTime) {
    later(&LAST, time);
}

fn later(last: &AtomicI64, now: DateTime) -> DateTime {
    let now = now.timestamp_millis();
    DateTime::from_millis(last.fetch_max(now, Ordering::Relaxed).max(now))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_is_set_back_does_not_make_time_go_back() {
        let last = AtomicI64::new(i64::MIN);
        let times = [5, 3, 4, 6].map(|now| later(&last, DateTime::from_millis(now)).timestamp_millis());
        assert_eq!(times, [5, 5, 5, 6]);
    }
}
