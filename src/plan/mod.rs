//! Plans, the documents they are stored as, and how they are printed.
//!
//! A [`Plan`](crate::pddl::Plan) has the names of the problem. In documents and facts they are the
//! memory's values again: how a name turns into a value is the caller's function, the
//! inverse of how values became names when the problem was generated.

mod document;
mod lineage;
mod print;
mod progress;
mod report;
mod repository;
mod source;

pub use document::{Layout, PlanDocumentError, Stored, failure, from_document, to_document, whole};
pub use lineage::{Answered, IMPORTED, Lineage, Racer, hash};
pub use print::{FactLayout, Format, PrintError, PrintedPlan};
pub use progress::{Progress, Status};
pub use report::{reported, rounded};
pub use repository::{LAST, Last, Record, Repository, RepositoryError, spelled};
pub use source::{Input, SourceError, TaskSource};
