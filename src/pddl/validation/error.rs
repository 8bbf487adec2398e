//! Why a condition cannot be evaluated.

/// Why a condition has no truth value.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::pddl) enum EvaluationError {
    /// The plan is wrong: a number is asked for that is not there.
    Wrong(String),
    /// The simulation does not know this part of PDDL.
    Unchecked(String),
}
