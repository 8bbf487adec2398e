//! Proofs that there is no plan, beside the searches for one: by the bounds of numbers, by the pairs of facts that states
//! can have, and by a search through all states.

mod alive;
mod bounds;
mod exhaust;
mod fixpoint;
mod obstacle;
mod pairs;
#[cfg(test)]
mod tests;

use super::lazy::Step;
use super::task::{Fact, Task};
use alive::Known;
use bounds::{Bounds, bounds};
use exhaust::Exhaust;

/// How much more a search may do where fewer and fewer states are left to be looked at.
const NEAR: u64 = 8;

/// The search for a proof, which can be continued.
pub(super) struct Prover<'t> {
    task: &'t Task,
    search: Option<Exhaust<'t>>,
}

impl<'t> Prover<'t> {
    pub(super) fn new(task: &'t Task) -> Self {
        Self { task, search: None }
    }

    /// Returns how many states were reached.
    pub(super) fn states(&self) -> usize {
        self.search.as_ref().map_or(0, Exhaust::states)
    }

    /// Looks for a proof until so much work is done, in so many bytes.
    pub(super) fn run(&mut self, work: u64, memory: usize) -> Step {
        let search = match &mut self.search {
            Some(search) => search,
            None => {
                // Pairs of facts know nothing of numbers.
                let known = match self.task.numbers.count {
                    0 => alive::alive(self.task, work),
                    _ => Known::TooLarge,
                };
                let alive = match known {
                    Known::Unsolvable => return Step::Exhausted,
                    Known::Alive(alive) => Some(alive),
                    Known::TooLarge => None,
                    // There is more work for it next time.
                    Known::Nothing => return Step::Spent,
                };
                self.search.insert(Exhaust::new(self.task, alive))
            }
        };
        for _ in 0..NEAR {
            let waiting = search.waiting();
            let step = search.run(work, memory);
            if step != Step::Spent || search.waiting() > waiting {
                return step;
            }
        }
        Step::Spent
    }
}

/// Says what stands in the way where the bounds of numbers show, with so much work, that no state behind this one is a goal.
pub(super) fn obstacle(task: &Task, state: &[Fact], work: u64) -> Option<String> {
    match bounds(task, state, work) {
        Bounds::Refuted(missing, intervals) => Some(obstacle::text(task, &missing, &intervals)),
        Bounds::Open | Bounds::Spent => None,
    }
}

/// Whether the pairs of facts alone show that there is no plan.
#[cfg(test)]
pub(in super::super) fn refutes(task: &Task) -> bool {
    task.numbers.count == 0 && matches!(alive::alive(task, u64::MAX), Known::Unsolvable)
}
