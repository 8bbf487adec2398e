//! How a planner's run ended.

use crate::pddl::Plan;

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// A plan; the empty one where the goal holds already.
    Plan(Plan),
    /// There is no plan: as rmem has proved, or as the planner says.
    Unsolvable,
    /// The planner gave up without a proof.
    GaveUp,
    /// It ran into the limit of memory.
    OutOfMemory,
    /// It ran into the limit of time.
    OutOfTime,
    /// It returned an invalid plan.
    Invalid,
    /// It crashed: a signal ended it, or it ended with an exit code other than 0 and without a plan.
    Failed,
    /// It ended well, but what it returned is not a plan.
    NoPlan,
    /// Its program is there, but cannot be executed.
    NotExecutable,
    /// It cannot handle a feature that the task uses.
    Unsupported,
    /// There is no such program.
    NotFound,
    /// rmem was interrupted.
    Interrupted,
}

impl Outcome {
    /// The word for it in documents. Outcomes that an executive treats alike have one word; the message tells them apart.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Plan(_) => "success",
            Self::Unsolvable => "unsolvable",
            Self::GaveUp => "gave-up",
            Self::OutOfMemory => "memory",
            Self::OutOfTime => "timeout",
            Self::Invalid | Self::NoPlan => "invalid",
            Self::Failed | Self::NotExecutable => "crashed",
            Self::Unsupported => "unsupported",
            Self::NotFound => "not-found",
            Self::Interrupted => "interrupted",
        }
    }

    /// The sentence for it in messages.
    #[must_use]
    pub fn sentence(&self) -> &'static str {
        match self {
            Self::Plan(_) => "a plan was found",
            Self::Unsolvable => "no plan exists",
            Self::GaveUp => "the planner gave up without proof",
            Self::OutOfMemory => "the planner ran out of memory",
            Self::OutOfTime => "the planner ran out of time",
            Self::Invalid => "the planner returned an invalid plan",
            Self::Failed => "the planner crashed",
            Self::NoPlan => "the planner returned what is not a plan",
            Self::NotExecutable => "the planner's program cannot be executed",
            Self::Unsupported => "the planner cannot handle the task",
            Self::NotFound => "the planner's program was not found",
            Self::Interrupted => "interrupted",
        }
    }

    /// The plan, where there is one.
    #[must_use]
    pub fn plan(&self) -> Option<&Plan> {
        match self {
            Self::Plan(plan) => Some(plan),
            _ => None,
        }
    }
}
