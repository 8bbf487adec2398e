//! Planners: programs under limits, one file per planner.
//!
//! A [`Planner`] says how its program is called and how what it says is read.
//! [`run`] does the rest, for all of them alike: it refuses what the planner cannot
//! do, writes the task in names every planner understands ([`portable`](crate::formats::pddl::portable)), runs the program
//! under [`Limits`] with nothing left behind ([`crate::process`]), and turns what comes
//! back into a [`Run`] whose [`Outcome`] has an exit code and whose plan is in the
//! domain's and the problem's own spelling. A [`Portfolio`] lets several planners run at once.

pub mod builtin;

mod attempt;
mod capabilities;
mod complaint;
mod conclusion;
mod configured;
mod downward;
mod ff;
mod files;
mod interface;
mod outcome;
mod progress;
mod race;
mod registry;
mod run;
mod sizes;
mod spelling;
mod task;

pub use crate::process::{Host, Limits, Listener};
pub use attempt::run;
pub use builtin::Builtin;
pub use capabilities::not_improved;
pub use configured::{Configured, Dialect};
pub use downward::FastDownward;
pub use ff::Ff;
pub use interface::{Output, Planner};
pub use outcome::Outcome;
pub use progress::progress;
pub use race::{Portfolio, Race};
pub use registry::{Registry, UnknownPlanner};
pub use run::{Run, spaced};
pub use sizes::Sizes;
pub use task::Task;
