//! Why planning failed before it had an outcome.

use crate::fault::{AtFault, Fault};
use crate::formats::Diagnostics;
use crate::plan::{PlanDocumentError, RepositoryError, SourceError};
use crate::problem::{Generated, ProblemError};
use crate::store::StoreError;

/// Why there is no result. That there is no plan is a result.
#[derive(Debug, thiserror::Error)]
pub enum PlanningError {
    /// The domain or the problem is wrong.
    #[error("{wrong}")]
    Pddl {
        /// What is wrong, and where.
        #[source]
        wrong: Diagnostics,
        /// The problem, where a template made it.
        generated: Option<Box<Generated>>,
    },
    /// The problem could not be generated.
    #[error("{0}")]
    Problem(#[source] ProblemError),
    /// The request names no planner.
    #[error("no planner is named; expected at least one")]
    NoPlanner,
    /// The plan could not be stored.
    #[error("storing the plan")]
    Storing(#[source] StoreError),
    /// The store failed otherwise.
    #[error("{0}")]
    Store(#[source] StoreError),
    /// The stored plan was not found.
    #[error("{0}")]
    Repository(#[source] RepositoryError),
    /// The stored plan does not say what it was made from.
    #[error("{id}: {error}")]
    NoSource {
        /// The plan.
        id: String,
        /// What is missing.
        #[source]
        error: SourceError,
    },
    /// The stored document is not a plan.
    #[error("{id} is not a plan that rmem can read: {error}")]
    NotAPlan {
        /// The document.
        id: String,
        /// What is wrong with it.
        #[source]
        error: PlanDocumentError,
    },
}

impl PlanningError {
    /// Returns the problem that is wrong, where a template made it.
    #[must_use]
    pub fn generated(&self) -> Option<&Generated> {
        match self {
            Self::Pddl { generated, .. } => generated.as_deref(),
            _ => None,
        }
    }
}

impl AtFault for PlanningError {
    fn fault(&self) -> Fault {
        match self {
            Self::Pddl { wrong, .. } => wrong.fault(),
            Self::NoPlanner | Self::NoSource { .. } | Self::NotAPlan { .. } => Fault::Input,
            Self::Problem(error) => error.fault(),
            Self::Storing(error) | Self::Store(error) => error.fault(),
            Self::Repository(error) => error.fault(),
        }
    }
}

impl From<Diagnostics> for PlanningError {
    fn from(wrong: Diagnostics) -> Self {
        Self::Pddl { wrong, generated: None }
    }
}

impl From<ProblemError> for PlanningError {
    fn from(error: ProblemError) -> Self {
        Self::Problem(error)
    }
}

impl From<StoreError> for PlanningError {
    fn from(error: StoreError) -> Self {
        Self::Store(error)
    }
}

impl From<RepositoryError> for PlanningError {
    fn from(error: RepositoryError) -> Self {
        Self::Repository(error)
    }
}
