//! The accepted landmarks of states. There are far fewer sets of them than states: each set is kept once.

use super::super::rows::{RowId, Rows};
use super::super::state::StateId;
use super::count::Counter;

/// The set of each state.
#[derive(Debug)]
pub(in super::super) struct Accepted {
    sets: Rows<u64>,
    states: Vec<RowId>,
}

impl Accepted {
    pub(in super::super) fn new(counter: &Counter) -> Self {
        Self { sets: Rows::new(counter.words()), states: Vec::new() }
    }

    pub(in super::super) fn get(&self, state: StateId) -> &[u64] {
        self.sets.get(self.states[state as usize])
    }

    /// Adds the set of the next state.
    pub(in super::super) fn push(&mut self, set: &[u64]) {
        let (number, _) = self.sets.insert(set);
        self.states.push(number);
    }

    /// Leaves a state, and the set, only what is in the sets of both.
    pub(in super::super) fn meet(&mut self, state: StateId, set: &mut [u64]) {
        set.iter_mut().zip(self.get(state)).for_each(|(word, known)| *word &= known);
        let (number, _) = self.sets.insert(set);
        self.states[state as usize] = number;
    }

    /// Returns about how many bytes they take.
    pub(in super::super) fn bytes(&self) -> usize {
        self.sets.bytes() + size_of_val(self.states.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_two_ways_to_a_state_only_what_is_on_both_is_accepted() {
        let mut accepted = Accepted { sets: Rows::new(1), states: Vec::new() };
        [[0b0111], [0b0111], [0b1000]].iter().for_each(|set| accepted.push(set));
        assert_eq!(accepted.sets.len(), 2);
        let mut set = [0b1110];
        accepted.meet(1, &mut set);
        assert_eq!(set, [0b0110]);
        assert_eq!([0, 1, 2].map(|state| accepted.get(state)[0]), [0b0111, 0b0110, 0b1000]);
    }
}
