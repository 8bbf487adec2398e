//! How states were reached.

use super::axiom::Axioms;
use super::state::{NO_STATE, Space, StateId};
use super::successor::{Generator, apply};
use super::task::{OperatorId, Task};

/// The state before each state, and the operator that leads on from it.
#[derive(Debug, Default)]
pub(super) struct Ways {
    parents: Vec<(StateId, OperatorId)>,
}

impl Ways {
    /// Adds the way to the next state.
    pub(super) fn push(&mut self, parent: StateId, operator: OperatorId) {
        self.parents.push((parent, operator));
    }

    /// Sets another way to a state.
    pub(super) fn set(&mut self, id: StateId, parent: StateId, operator: OperatorId) {
        self.parents[id as usize] = (parent, operator);
    }

    /// Returns about how many bytes they take.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.parents.as_slice())
    }

    /// Returns the operators that led to a state.
    pub(super) fn plan(&self, mut id: StateId) -> Vec<OperatorId> {
        let mut plan = Vec::new();
        while self.parents[id as usize].0 != NO_STATE {
            let (parent, operator) = self.parents[id as usize];
            plan.push(operator);
            id = parent;
        }
        plan.reverse();
        plan
    }
}

/// The states that were expanded at once, all their successors one after the other. Which operator led to a state is found
/// out again: it is the first one that leads there.
#[derive(Debug, Default)]
pub(super) struct Expansions {
    /// States that were expanded with any new successor, each behind the first of these.
    parents: Vec<(StateId, StateId)>,
}

impl Expansions {
    /// Notes that a state is expanded, when the next state that is found has the number `next`.
    pub(super) fn push(&mut self, parent: StateId, next: StateId) {
        match self.parents.last_mut() {
            // The one before led to nothing new.
            Some((first, last)) if *first == next => *last = parent,
            _ => self.parents.push((next, parent)),
        }
    }

    /// Returns about how many bytes they take.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.parents.as_slice())
    }

    /// Returns the operators that led to a state.
    pub(super) fn plan(&self, task: &Task, generator: &Generator, space: &Space, mut id: StateId) -> Vec<OperatorId> {
        let (mut plan, mut axioms) = (Vec::new(), Axioms::new(task));
        let (mut before, mut after) = (task.init.clone(), task.init.clone());
        let mut state = task.init.clone();
        let mut applicable = Vec::new();
        while let Some(place) = self.parents.partition_point(|(first, _)| *first <= id).checked_sub(1) {
            let (_, parent) = self.parents[place];
            space.state(id, &mut after);
            space.state(parent, &mut before);
            applicable.clear();
            generator.applicable(task, &before, &mut applicable);
            plan.extend(applicable.iter().copied().find(|operator| {
                state.copy_from_slice(&before);
                apply(task, &mut axioms, &task.operators[*operator as usize], &mut state);
                state == after
            }));
            id = parent;
        }
        plan.reverse();
        plan
    }
}

#[cfg(test)]
mod tests {
    use super::super::example::random;
    use super::*;

    #[test]
    fn the_operators_on_the_way_to_a_state_are_found_again() {
        let mut count = 0;
        for task in (0..200).map(random) {
            let (generator, mut axioms) = (Generator::new(&task), Axioms::new(&task));
            let (mut space, mut ways, mut expansions) = (Space::new(&task), Ways::default(), Expansions::default());
            let mut state = task.init.clone();
            axioms.derive(&task, &mut state);
            space.insert(&state);
            ways.push(NO_STATE, OperatorId::MAX);
            let mut next = 0;
            while next < (space.len() as StateId).min(100) {
                expansions.push(next, space.len() as StateId);
                let mut applicable = Vec::new();
                space.state(next, &mut state);
                generator.applicable(&task, &state, &mut applicable);
                for operator in applicable {
                    space.state(next, &mut state);
                    apply(&task, &mut axioms, &task.operators[operator as usize], &mut state);
                    if space.insert(&state).1 {
                        ways.push(next, operator);
                    }
                }
                next += 1;
            }
            for id in 0..space.len() as StateId {
                assert_eq!(expansions.plan(&task, &generator, &space, id), ways.plan(id));
                count += 1;
            }
        }
        assert!(count > 500, "{count}");
    }
}
