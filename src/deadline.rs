//! Until when work in a thread may take: stores look at it between documents.

use std::cell::Cell;
#[cfg(any(feature = "mongodb", test))]
use std::time::Duration;
use std::time::Instant;

thread_local! {
    static UNTIL: Cell<Option<Instant>> = const { Cell::new(None) };
}

/// While it lives, work of stores in this thread fails once its time has come.
#[cfg(any(feature = "serve", test))]
#[derive(Debug)]
pub(crate) struct Deadline {
    /// The one that was in effect before.
    before: Option<Instant>,
}

#[cfg(any(feature = "serve", test))]
impl Deadline {
    /// Sets the deadline of this thread; `None` is none.
    pub(crate) fn set(until: Option<Instant>) -> Self {
        Self { before: UNTIL.replace(until) }
    }
}

#[cfg(any(feature = "serve", test))]
impl Drop for Deadline {
    fn drop(&mut self) {
        UNTIL.set(self.before);
    }
}

/// Whether the deadline of this thread has passed.
pub(crate) fn has_passed() -> bool {
    UNTIL.get().is_some_and(|until| Instant::now() >= until)
}

/// How long it is until the deadline of this thread, where there is one.
#[cfg(any(feature = "mongodb", test))]
pub(crate) fn left() -> Option<Duration> {
    UNTIL.get().map(|until| until.saturating_duration_since(Instant::now()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deadline_holds_while_its_guard_lives() {
        assert!(!has_passed() && left().is_none());
        let late = Deadline::set(Some(Instant::now() + Duration::from_secs(3600)));
        assert!(!has_passed() && left().is_some_and(|left| left > Duration::from_secs(3000)));
        let passed = Deadline::set(Some(Instant::now()));
        assert!(has_passed() && left() == Some(Duration::ZERO));
        drop(passed);
        assert!(!has_passed() && left().is_some());
        drop(late);
        assert!(left().is_none());
    }
}
