//! The clock, which can be stopped, so that the same input gives the same bytes.

use bson::DateTime;

/// Where the dates in metadata come from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Clock {
    /// The system's clock.
    #[default]
    System,
    /// Always the same time.
    Stopped(DateTime),
}

impl Clock {
    /// The time.
    #[must_use]
    pub fn now(self) -> DateTime {
        match self {
            Self::System => DateTime::now(),
            Self::Stopped(at) => at,
        }
    }
}
