//! Until when work in a thread may take, and whether it is to end before that: stores look at it between documents.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};
#[cfg(any(feature = "mongodb", test))]
use std::time::Duration;
use std::time::Instant;

/// Whether an operation is to end before it is done. Any thread may say so.
#[derive(Debug, Default)]
pub(crate) struct Stop(AtomicI32);

/// An operation that is not to be stopped.
const GO_ON: i32 = 0;

impl Stop {
    /// Ends the operation with MongoDB's code for the reason; the first reason counts.
    #[cfg(any(feature = "serve", test))]
    pub(crate) fn stop(&self, code: i32) {
        // It has a reason already where that fails.
        let _ = self.0.compare_exchange(GO_ON, code, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// The reason, where it is to end.
    fn code(&self) -> Option<i32> {
        Some(self.0.load(Ordering::Relaxed)).filter(|code| *code != GO_ON)
    }
}

/// What ends an operation before it is done.
#[derive(Debug, Clone, Default)]
pub(crate) struct Limits {
    /// When it has taken as long as it may.
    pub(crate) until: Option<Instant>,
    /// Where others may stop it.
    pub(crate) stop: Option<Arc<Stop>>,
}

/// Why an operation is to end before it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    /// It has taken as long as it may.
    OutOfTime,
    /// It was stopped, with MongoDB's code for the reason.
    Stopped(i32),
}

impl Limits {
    /// Why the operation is to end, where it is.
    pub(crate) fn ending(&self) -> Option<Ending> {
        if let Some(code) = self.stop.as_ref().and_then(|stop| stop.code()) {
            return Some(Ending::Stopped(code));
        }
        self.until.is_some_and(|until| Instant::now() >= until).then_some(Ending::OutOfTime)
    }
}

thread_local! {
    static LIMITS: RefCell<Limits> = const { RefCell::new(Limits { until: None, stop: None }) };
}

/// While it lives, work of stores in this thread fails once it is to end.
#[derive(Debug)]
pub(crate) struct Deadline {
    /// The limits that were in effect before.
    before: Limits,
}

impl Deadline {
    /// Sets the limits of this thread.
    pub(crate) fn set(limits: Limits) -> Self {
        Self { before: LIMITS.replace(limits) }
    }
}

impl Drop for Deadline {
    fn drop(&mut self) {
        LIMITS.set(std::mem::take(&mut self.before));
    }
}

/// The limits of this thread, for another one that does a part of its work.
pub(crate) fn limits() -> Limits {
    LIMITS.with_borrow(Clone::clone)
}

/// Why the work of this thread is to end, where it is.
pub(crate) fn ending() -> Option<Ending> {
    LIMITS.with_borrow(Limits::ending)
}

/// How long it is until the deadline of this thread, where there is one.
#[cfg(any(feature = "mongodb", test))]
pub(crate) fn left() -> Option<Duration> {
    LIMITS.with_borrow(|limits| limits.until).map(|until| until.saturating_duration_since(Instant::now()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn until(until: Instant) -> Limits {
        Limits { until: Some(until), stop: None }
    }

    #[test]
    fn a_deadline_holds_while_its_guard_lives() {
        assert!(ending().is_none() && left().is_none());
        let late = Deadline::set(until(Instant::now() + Duration::from_secs(3600)));
        assert!(ending().is_none() && left().is_some_and(|left| left > Duration::from_secs(3000)));
        let passed = Deadline::set(until(Instant::now()));
        assert!(ending() == Some(Ending::OutOfTime) && left() == Some(Duration::ZERO));
        drop(passed);
        assert!(ending().is_none() && left().is_some());
        drop(late);
        assert!(left().is_none());
    }

    #[test]
    fn another_thread_stops_an_operation_and_the_first_reason_counts() {
        let stop = Arc::new(Stop::default());
        let stopped = Deadline::set(Limits { until: Some(Instant::now()), stop: Some(Arc::clone(&stop)) });
        assert_eq!(ending(), Some(Ending::OutOfTime));
        let limits = limits();
        std::thread::spawn(move || stop.stop(11_601)).join().unwrap();
        limits.stop.as_ref().unwrap().stop(279);
        assert_eq!((ending(), limits.ending()), (Some(Ending::Stopped(11_601)), Some(Ending::Stopped(11_601))));
        drop(stopped);
        assert!(ending().is_none());
    }
}
