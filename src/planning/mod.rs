//! Planning, from a request to a stored plan, and looking after the plan while it is executed.
//!
//! `rmem plan`, `plan --watch`, `plan check`, `plan rerun` and programs of CLIPS share this workflow:
//!
//! 1. [`prepare`] instantiates the problem, a [`PlanningTask`], while the planners' programs start,
//! 2. [`PreparedSearch::search`] runs the planners and gives a [`PlanResult`], whose plan was simulated,
//! 3. [`PlanResult::store`] stores the plan with its lineage,
//! 4. [`check`] says whether the rest of a stored plan still reaches its goal, and [`Monitor`] waits until
//!    that may have changed.
//!
//! Nothing is printed here: results say what there is to print.

mod check;
pub mod comparison;
mod error;
mod lineage;
mod monitor;
mod request;
mod result;
mod search;
mod task;

pub use check::{Check, Fault, Origin, check};
pub use error::PlanningError;
pub use monitor::{Monitor, PlanState};
pub use request::{DEFAULT_TIMEOUT, MAX_OUTPUT, PlanRequest, SearchOptions};
pub use result::{Note, PlanResult};
pub use search::{PreparedSearch, prepare, prepare_started, start};
pub use task::PlanningTask;
