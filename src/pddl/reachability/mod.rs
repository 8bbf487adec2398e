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
mod relaxed;
mod rule;

use std::fmt;

use super::domain::Domain;
use super::problem::Problem;
use relaxed::Relaxed;

/// How much is looked at before the attempt is given up, in tried facts and objects.
const LIMIT: u64 = 5_000_000;

/// What keeps a goal from being reached.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Why {
    /// Whether the task was too large, or uses what is not simulated; then nothing else is known.
    pub is_unknown: bool,
    /// The conditions of the goal that can never hold, then the conditions behind them; not all of very many.
    pub obstacles: Vec<Obstacle>,
    /// How many of the obstacles stand in the goal itself.
    pub goals: usize,
    /// Predicates that actions ask for, that are true of nothing at first and that no action can
    /// make true.
    pub unfilled: Vec<String>,
}

/// A condition that can never hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// As PDDL, with variables where any object would do.
    pub condition: String,
    /// The actions and rules that would make it hold; not all of very many.
    pub achievers: Vec<Achiever>,
}

/// What would make a condition hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Achiever {
    /// The action with its objects, and variables where any object would do.
    pub action: String,
    /// What it lacks, as PDDL. Empty where each of its conditions can hold, but never all for
    /// the same objects.
    pub missing: Vec<String>,
}

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

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_unknown {
            return f.write_str("why: not known; the task is too large, or uses what is not simulated");
        }
        if self.goals == 0 {
            f.write_str("why: each condition of the goal could be reached if nothing were ever undone; ")?;
            f.write_str("what actions delete, numbers or times stand in the way")?;
        }
        for (place, obstacle) in self.obstacles.iter().enumerate() {
            if place > 0 {
                f.write_str("\n")?;
            }
            let what = if place < self.goals { "why: the goal asks for " } else { "     and " };
            write!(f, "{what}{}, which can never hold", obstacle.condition)?;
            if obstacle.achievers.is_empty() {
                f.write_str(": nothing makes it so")?;
            }
            for achiever in &obstacle.achievers {
                match achiever.missing.as_slice() {
                    [] => write!(f, "\n       {} would, but never finds all it needs together", achiever.action)?,
                    missing => write!(f, "\n       {} would, but needs {}", achiever.action, missing.join(", "))?,
                }
            }
        }
        if !self.unfilled.is_empty() {
            write!(f, "\nnever filled, and never made true: {}", self.unfilled.join(", "))?;
        }
        Ok(())
    }
}
