//! Plans, the documents they are stored as, and how they are printed.
//!
//! A [`Plan`] has the names of the problem. In documents and facts they are the
//! memory's values again: how a name turns into a value is the caller's function, the
//! inverse of how values became names when the problem was generated.

mod document;
mod lineage;
mod print;
mod progress;
mod repository;
mod source;
mod spacing;
mod spelling;
mod svg;

use crate::formats::plan::{Action, PlanFile};
use crate::pddl::Step;

pub use document::{Layout, PlanDocumentError, Stored, failure, from_document, to_document};
pub use lineage::{Answered, IMPORTED, Lineage, Racer, hash};
pub use print::{Format, PrintError, PrintedPlan};
pub use progress::{Progress, Status};
pub use repository::{Archive, ArchiveError, LAST, Record, spelled};
pub use source::{Input, RecipeError, TaskSource};

/// A sequence of ground actions that reaches a goal.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// The actions; sequential plans in order, temporal plans by start time.
    pub steps: Vec<Step>,
    /// The planner's word on what it costs.
    pub cost: Option<f64>,
}

impl Plan {
    /// Whether its actions have times.
    #[must_use]
    pub fn is_temporal(&self) -> bool {
        self.steps.iter().any(|step| step.start.is_some())
    }
}

impl From<PlanFile> for Plan {
    fn from(file: PlanFile) -> Self {
        let step = |action: Action| Step {
            action: action.name,
            arguments: action.arguments,
            start: action.start,
            duration: action.duration,
        };
        Self { steps: file.actions.into_iter().map(step).collect(), cost: file.cost }
    }
}
