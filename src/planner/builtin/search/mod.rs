//! A satisficing planner for classical tasks: what it is given is a [`lifted`] task, which [`ground()`] makes a
//! [`task`], for which [`solve()`] finds plans.
//!
//! It knows nothing of the rest of the crate. Each file names the paper that its algorithm is from.

mod achieve;
mod axiom;
#[cfg(test)]
mod example;
pub mod ground;
mod hash;
mod improve;
mod interval;
mod landmark;
mod lazy;
pub mod lifted;
pub mod makespan;
pub mod number;
mod open;
mod preferred;
mod prove;
mod relaxed;
pub mod reservoir;
mod rows;
mod shorten;
#[cfg(test)]
pub(super) mod simulate;
mod solve;
mod state;
mod successor;
pub mod task;
#[cfg(test)]
mod tests;
mod ways;
mod width;

#[cfg(test)]
pub(super) use prove::refutes;

pub use ground::{Ground, Refusal, ground};
pub use solve::{End, Event, Improvement, Settings, prove, solve};
