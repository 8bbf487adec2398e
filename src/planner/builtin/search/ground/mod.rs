//! From a lifted task to a ground one with finite domains, in the steps of Helmert (2009, "Concise finite-domain
//! representations for PDDL planning tasks", Artificial Intelligence 173): relaxed reachability, instances,
//! simplification, invariants, encoding.

mod encode;
mod formula;
mod instance;
mod invariant;
mod layer;
mod ledger;
mod reach;
mod refusal;
mod relation;
mod rule;
mod simplify;

pub use refusal::Refusal;

use super::lifted::Lifted;
use super::task::Task;

/// What becomes of a task.
#[derive(Debug)]
pub enum Ground {
    /// A task to be searched.
    Task(Box<Task>),
    /// The goal cannot be reached, even if nothing ever became false.
    GoalFalse,
}

/// Grounds a task in about so many bytes. Where that takes long, `report` is called with what has how many instances so far.
///
/// # Errors
///
/// Where there are too many instances, too many parameters, or axioms without an order.
pub fn ground(lifted: &Lifted, memory: usize, report: &mut dyn FnMut(&str, usize)) -> Result<Ground, Refusal> {
    let mut reached = reach::Reached::new(lifted, memory, report)?;
    let mut atoms = formula::Atoms::new(&reached);
    let mut instances = instance::instantiate(&mut reached, &mut atoms, memory)?;
    if instances.is_hopeless {
        return Ok(Ground::GoalFalse);
    }
    let is_relevant = simplify::simplify(&mut instances);
    if instances.is_hopeless {
        return Ok(Ground::GoalFalse);
    }
    let groups = invariant::Finder::new(&reached, &atoms, &instances, &is_relevant).groups();
    let mut task = encode::encode(&reached, &atoms, &instances, &is_relevant, groups);
    // Two goals that exclude each other.
    if task.goal.iter().any(|fact| *fact as usize >= task.facts()) {
        return Ok(Ground::GoalFalse);
    }
    layer::order(&mut task)?;
    task.relaxed_facts += task.numbers.count * 2;
    Ok(Ground::Task(Box::new(task)))
}
