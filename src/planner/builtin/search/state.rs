//! States, packed into words of bits, each kept once.

use super::rows::{RowId, Rows};
use super::task::{Fact, Task};

/// The number of a state that was reached.
pub(super) type StateId = RowId;

/// The bits of a word.
const WORD: u32 = u32::BITS;

/// No state.
pub(super) const NO_STATE: StateId = StateId::MAX;

/// Where the value of each variable is in the words of a state.
#[derive(Debug)]
pub(super) struct Packer {
    /// Word, shift and mask of each variable.
    places: Vec<(u32, u32, u32)>,
    offsets: Vec<Fact>,
    /// How many words the facts take, and then the numbers.
    facts: usize,
    words: usize,
}

impl Packer {
    /// Gives each variable as many bits as its values need, the largest first, none across two words: each goes to a word
    /// of those with the least room that suffices.
    pub(super) fn new(task: &Task) -> Self {
        let bits = |variable: usize| (usize::BITS - (task.domain(variable).len() - 1).leading_zeros()).max(1);
        let mut order: Vec<usize> = (0..task.len()).collect();
        order.sort_by_key(|variable| std::cmp::Reverse(bits(*variable)));
        let mut places = vec![(0, 0, 0); task.len()];
        // The words with so many free bits.
        let mut free: [Vec<u32>; WORD as usize] = Default::default();
        let mut words = 0;
        for variable in order {
            let bits = bits(variable);
            let fit = (bits..WORD).find_map(|room| Some((free[room as usize].pop()?, room)));
            let (word, room) = fit.unwrap_or_else(|| {
                words += 1;
                (words - 1, WORD)
            });
            places[variable] = (word, WORD - room, u32::MAX >> (WORD - bits));
            free[(room - bits) as usize].push(word);
        }
        let facts = (words as usize).max(1);
        Self { places, offsets: task.offsets.clone(), facts, words: facts + task.numbers.count * 2 }
    }

    /// Packs the facts of a state, one of each variable, and its numbers.
    pub(super) fn pack(&self, facts: &[Fact], words: &mut [u32]) {
        let (own, numbers) = words.split_at_mut(self.facts);
        own.fill(0);
        for ((fact, offset), (word, shift, _)) in facts.iter().zip(&self.offsets).zip(&self.places) {
            own[*word as usize] |= (fact - offset) << shift;
        }
        numbers.copy_from_slice(&facts[self.places.len()..]);
    }

    /// Unpacks what was packed.
    pub(super) fn unpack(&self, words: &[u32], facts: &mut [Fact]) {
        for ((fact, offset), (word, shift, mask)) in facts.iter_mut().zip(&self.offsets).zip(&self.places) {
            *fact = offset + (words[*word as usize] >> shift & mask);
        }
        facts[self.places.len()..].copy_from_slice(&words[self.facts..]);
    }
}

/// The states that were reached, each kept once.
#[derive(Debug)]
pub(super) struct Space {
    packer: Packer,
    rows: Rows<u32>,
    buffer: Vec<u32>,
}

impl Space {
    pub(super) fn new(task: &Task) -> Self {
        let packer = Packer::new(task);
        Self { rows: Rows::new(packer.words), buffer: vec![0; packer.words], packer }
    }

    /// Returns how many states there are.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Returns about how many bytes they take.
    pub(super) fn bytes(&self) -> usize {
        self.rows.bytes()
    }

    /// Adds a state; says its number and whether it is new.
    pub(super) fn insert(&mut self, facts: &[Fact]) -> (StateId, bool) {
        self.packer.pack(facts, &mut self.buffer);
        self.rows.insert(&self.buffer)
    }

    /// Unpacks a state.
    pub(super) fn state(&self, id: StateId, facts: &mut [Fact]) {
        self.packer.unpack(self.rows.get(id), facts);
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
            assert_eq!(space.insert(state), (number as StateId, true));
        }
        let mut facts = vec![0; 3];
        for (number, state) in states.iter().enumerate() {
            assert_eq!(space.insert(state), (number as StateId, false));
            space.state(number as StateId, &mut facts);
            assert_eq!(&facts, state);
        }
    }
}
