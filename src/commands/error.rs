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
            Outcome::Invalid | Outcome::Failed => Self::PlannerBroken,
            Outcome::Unsupported => Self::Unsupported,
            Outcome::NotFound => Self::PlannerNotFound,
            Outcome::Interrupted => Self::Interrupted,
        }
    }
}

/// The exit code of an outcome that is stored as a word.
pub(super) fn exit_of_word(word: &str) -> Exit {
    match word {
        "success" => Exit::Done,
        "unsolvable" => Exit::Unsolvable,
        "timeout" => Exit::OutOfTime,
        "memory" => Exit::OutOfMemory,
        "invalid" | "crashed" => Exit::PlannerBroken,
        "unsupported" => Exit::Unsupported,
        "not-found" => Exit::PlannerNotFound,
        "interrupted" => Exit::Interrupted,
        _ => Exit::GaveUp,
    }
}
