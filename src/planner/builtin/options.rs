//! What the planner is asked for.

/// What `rmem ff` is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Improve the first plan, within bounds: its cost, its preferences.
    pub optimize: bool,
    /// Say the first plan at once and every better one after it, for as long as there may be one.
    pub anytime: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { optimize: true, anytime: false }
    }
}
