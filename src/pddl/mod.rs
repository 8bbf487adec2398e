//! What PDDL means: domains, problems, checks, and the simulation of plans.
//!
//! How it is spelled is [`crate::formats::pddl`]'s business. A [`Domain`] is read and
//! checked by itself, a [`Problem`] against its domain; what passes has every name
//! resolved. [`validate`] simulates a plan, and [`repair`] says what would mend one that breaks; [`why`] says what
//! keeps a goal from ever being reached. Names compare without regard to case and keep the spelling they were declared
//! with.

mod axiom;
mod domain;
mod facts;
mod feature;
mod happenings;
mod model;
mod plan;
mod problem;
mod reachability;
mod report;
mod resolve;
mod screen;
mod structure;
mod table;
mod types;
mod validation;
mod vocabulary;

pub use domain::{Action, Domain, Parameter, Predicate};
pub use feature::{Feature, Use};
pub use happenings::Reach;
pub use plan::{Plan, Step};
pub use problem::{Object, Problem};
pub use reachability::{Achiever, Obstacle, Why, why};
pub use screen::{Doubtful, Screen};
pub use structure::{Link, Structure};
pub use validation::{
    Cause, Event, Failure, Happening, Remedy, Repair, Validation, repair, repair_rest, trace, validate, validate_rest,
};
