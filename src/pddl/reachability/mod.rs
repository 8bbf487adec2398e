//! Why there is no plan: what can never come true, even if nothing were ever undone.
//!
//! Facts are collected that some action could make true if no action deleted anything, from the
//! initial state on until there is nothing new ([`relaxed`]). A condition of the goal that is not met
//! then is never met, whatever the plan. From there the way goes back: which actions would meet it,
//! and what they lack ([`cause`]).
//!
//! The collection errs on one side only: a condition is called unreachable where no plan can reach
//! it. Negations hold where a fact is missing at first or some action deletes it; numbers that
//! actions change may have any value; preferences and constraints are not looked at. What is too
//! large to be collected is not explained.

mod cause;
mod explanation;
mod relaxed;
mod rule;

use super::domain::Domain;
use super::problem::Problem;
use relaxed::Relaxed;

pub use explanation::{Achiever, Obstacle, Why};

/// How much is looked at before the attempt is given up, in tried facts and objects.
const LIMIT: u64 = 5_000_000;

/// Says what keeps the goal from being reached.
#[must_use]
pub fn why(domain: &Domain, problem: &Problem) -> Why {
    let unknown = || Why { is_unknown: true, ..Why::default() };
    let Ok(relaxed) = Relaxed::collect(domain, problem, LIMIT) else { return unknown() };
    if relaxed.is_cut() {
        return unknown();
    }
    match cause::explain(&relaxed) {
        Ok(why) if !relaxed.is_cut() => why,
        _ => unknown(),
    }
}
