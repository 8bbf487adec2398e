//! Simulation of plans: every planner's plan is checked independently of the planner.
//!
//! Only the plan's actions are instantiated, never the task. Conditions are looked up
//! in a set of facts, quantifiers range over the objects of their types, and derived
//! predicates are computed when a condition asks for them. Trajectory constraints watch the states as they come, and
//! violated preferences are counted where the metric asks.
//!
//! A plan is a sequence of [`happening`]s: moments at which actions start, end, or
//! take place, and timed initial literals come true. A sequential plan has one
//! action per moment, at the times 1, 2, 3, …

mod change;
mod derive;
mod error;
mod goal;
mod happening;
mod index;
mod interference;
mod join;
mod noted;
mod pending;
mod point;
mod preference;
mod program;
mod reads;
mod record;
mod repair;
mod simulation;
mod state;
mod stratum;
mod text;
mod trace;
mod trajectory;
mod truth;
mod verdict;

pub(super) use error::EvaluationError;
pub(super) use state::{Bindings, Ground, State, UNBOUND};
pub(super) use stratum::{free_slots, negative_cycle, predicates};

pub use repair::{Cause, Remedy, Repair, repair, repair_rest};
pub use simulation::{trace, validate, validate_rest};
pub use trace::{Event, Happening};
pub use verdict::{Failure, Validation};
