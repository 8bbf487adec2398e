//! What the planner is asked for.

/// What `rmem ff` is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Improve the first plan, within bounds: its cost, its preferences.
    pub optimize: bool,
    /// Say the first plan at once and every better one after it, for as long as there may be one.
    pub anytime: bool,
    /// Say every plan as soon as it is found, the best one last: whoever stops the search has the best so far.
    pub streamed: bool,
}

impl Options {
    /// Gives back what is not needed any more; where the process says plans and ends, its end does that at once.
    pub(super) fn free<T>(self, value: T) {
        if self.streamed {
            std::mem::forget(value);
        }
    }

    /// Whether plans are said before the search for better ones is over.
    pub(super) fn says_each(self) -> bool {
        self.anytime || self.streamed
    }
}

impl Default for Options {
    fn default() -> Self {
        Self { optimize: true, anytime: false, streamed: false }
    }
}
