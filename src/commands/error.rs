//! The exit codes of errors and outcomes.

use crate::exit::Exit;
use crate::planner::Outcome;

impl From<&Outcome> for Exit {
    fn from(outcome: &Outcome) -> Self {
        match outcome {
            Outcome::Plan(_) => Self::Done,
            Outcome::Unsolvable => Self::Unsolvable,
            Outcome::GaveUp => Self::GaveUp,
            Outcome::OutOfMemory => Self::OutOfMemory,
            Outcome::OutOfTime => Self::OutOfTime,
            Outcome::Failed => Self::PlannerBroken,
            Outcome::Unsupported => Self::Unsupported,
            Outcome::NotFound => Self::PlannerNotFound,
            Outcome::Interrupted => Self::Interrupted,
        }
    }
}
