//! States, packed into words of bits, each kept once.

use super::hash;
use super::task::{Fact, OperatorId, Task};

/// The number of a state that was reached.
pub(super) type StateId = u32;

/// No state.
pub(super) const NO_STATE: StateId = StateId::MAX;

/// Where the value of each variable is in the words of a state.
#[derive(Debug)]
pub(super) struct Packer {
    /// Word, shift and mask of each variable.
    places: Vec<(u32, u32, u64)>,
    offsets: Vec<Fact>,
    /// How many words the facts take, and then the numbers.
    facts: usize,
    words: usize,
}

impl Packer {
    /// Gives each variable as many bits as its values need, the largest first, none across two words.
    pub(super) fn new(task: &Task) -> Self {
        let bits = |variable: usize| (usize::BITS - (task.domain(variable).len() - 1).leading_zeros()).max(1);
        let mut order: Vec<usize> = (0..task.len()).collect();
        order.sort_by_key(|variable| std::cmp::Reverse(bits(*variable)));
        let mut places = vec![(0, 0, 0); task.len()];
        let mut free: Vec<u32> = Vec::new();
        for variable in order {
            let bits = bits(variable);
            // Full words are not looked at again: later variables need fewer bits, not more.
            let start = free.len().saturating_sub(2);
            let word = (start..free.len()).find(|word| free[*word] >= bits).unwrap_or_else(|| {
                free.push(64);
                free.len() - 1
            });
            places[variable] = (word as u32, 64 - free[word], (1_u64 << bits) - 1);
            free[word] -= bits;
        }
        let facts = free.len().max(1);
        Self { places, offsets: task.offsets.clone(), facts, words: facts + task.numbers.count }
    }

    /// Packs the facts of a state, one of each variable, and its numbers.
    pub(super) fn pack(&self, facts: &[Fact], words: &mut [u64]) {
        words.fill(0);
        for ((fact, offset), (word, shift, _)) in facts.iter().zip(&self.offsets).zip(&self.places) {
            words[*word as usize] |= u64::from(fact - offset) << shift;
        }
        let numbers = facts[self.places.len()..].chunks_exact(2);
        for (word, halves) in words[self.facts..].iter_mut().zip(numbers) {
            *word = u64::from(halves[0]) << 32 | u64::from(halves[1]);
        }
    }

    /// Unpacks what was packed.
    pub(super) fn unpack(&self, words: &[u64], facts: &mut [Fact]) {
        for ((fact, offset), (word, shift, mask)) in facts.iter_mut().zip(&self.offsets).zip(&self.places) {
            *fact = offset + (words[*word as usize] >> shift & mask) as Fact;
        }
        let numbers = facts[self.places.len()..].chunks_exact_mut(2);
        for (word, halves) in words[self.facts..].iter().zip(numbers) {
            halves.copy_from_slice(&[(word >> 32) as Fact, *word as Fact]);
        }
    }
}

/// The states that were reached, each with the operator that led to it.
#[derive(Debug)]
pub(super) struct Space {
    packer: Packer,
    words: Vec<u64>,
    buffer: Vec<u64>,
    /// Open addressing; a power of two of places.
    table: Vec<StateId>,
    parents: Vec<(StateId, OperatorId)>,
}

impl Space {
    pub(super) fn new(task: &Task) -> Self {
        let packer = Packer::new(task);
        let buffer = vec![0; packer.words];
        Self { packer, words: Vec::new(), buffer, table: vec![NO_STATE; 1024], parents: Vec::new() }
    }

    /// Returns how many states there are.
    pub(super) fn len(&self) -> usize {
        self.parents.len()
    }

    /// Returns about how many bytes they take.
    pub(super) fn bytes(&self) -> usize {
        self.words.capacity() * 8 + self.table.len() * 4 + self.parents.capacity() * 8
    }

    /// Adds a state; says its number and whether it is new.
    pub(super) fn insert(&mut self, facts: &[Fact], parent: StateId, operator: OperatorId) -> (StateId, bool) {
        let mut buffer = std::mem::take(&mut self.buffer);
        self.packer.pack(facts, &mut buffer);
        let place = self.place(&buffer);
        let found = self.table[place];
        let result = if found == NO_STATE {
            let id = self.parents.len() as StateId;
            self.table[place] = id;
            self.words.extend_from_slice(&buffer);
            self.parents.push((parent, operator));
            if self.parents.len() * 3 > self.table.len() * 2 {
                self.grow();
            }
            (id, true)
        } else {
            (found, false)
        };
        self.buffer = buffer;
        result
    }

    fn place(&self, words: &[u64]) -> usize {
        let mask = self.table.len() - 1;
        let mut place = hash::words(words) as usize & mask;
        while self.table[place] != NO_STATE && self.packed(self.table[place]) != words {
            place = (place + 1) & mask;
        }
        place
    }

    fn grow(&mut self) {
        let places = self.table.len() * 2;
        // The old table is gone before there is a new one.
        self.table = Vec::new();
        self.table = vec![NO_STATE; places];
        let mask = self.table.len() - 1;
        for id in 0..self.parents.len() as StateId {
            let mut place = hash::words(self.packed(id)) as usize & mask;
            while self.table[place] != NO_STATE {
                place = (place + 1) & mask;
            }
            self.table[place] = id;
        }
    }

    fn packed(&self, id: StateId) -> &[u64] {
        let (start, count) = (id as usize * self.packer.words, self.packer.words);
        &self.words[start..start + count]
    }

    /// Unpacks a state.
    pub(super) fn state(&self, id: StateId, facts: &mut [Fact]) {
        self.packer.unpack(self.packed(id), facts);
    }

    /// Sets another way to a state.
    pub(super) fn set_parent(&mut self, id: StateId, parent: StateId, operator: OperatorId) {
        self.parents[id as usize] = (parent, operator);
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn states_unpack_to_what_was_packed(values in prop::collection::vec((1_u32..400, any::<prop::sample::Index>()), 1..60)) {
            let domains: Vec<u32> = values.iter().map(|(size, _)| *size).collect();
            let init: Vec<u32> = values.iter().map(|(size, value)| value.index(*size as usize) as u32).collect();
            let task = super::super::example::task(&domains, &init, &[], &[]);
            let packer = Packer::new(&task);
            let (mut words, mut state) = (vec![0; packer.words], vec![0; task.len()]);
            packer.pack(&task.init, &mut words);
            packer.unpack(&words, &mut state);
            prop_assert_eq!(&state, &task.init);
        }
    }

    #[test]
    fn a_state_is_kept_once() {
        let task = super::super::example::task(&[40, 50, 60], &[0; 3], &[], &[]);
        let mut space = Space::new(&task);
        let states: Vec<Vec<Fact>> = (0..5000).map(|n| vec![n % 40, 40 + n / 40 % 50, 90 + n / 2000]).collect();
        for (number, state) in states.iter().enumerate() {
            assert_eq!(space.insert(state, NO_STATE, 0), (number as StateId, true));
        }
        let mut facts = vec![0; 3];
        for (number, state) in states.iter().enumerate() {
            assert_eq!(space.insert(state, NO_STATE, 0), (number as StateId, false));
            space.state(number as StateId, &mut facts);
            assert_eq!(&facts, state);
        }
    }
}
