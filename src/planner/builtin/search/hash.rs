//! A hash function for small keys of numbers: quick, and the same in every run.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Odd, with well-spread bits (the golden ratio of 2⁶⁴).
const FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;

/// A map with [`NumberHasher`].
pub(super) type NumberMap<K, V> = HashMap<K, V, BuildHasherDefault<NumberHasher>>;

/// Multiplies and rotates.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NumberHasher(u64);

impl NumberHasher {
    fn mix(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(26) ^ word).wrapping_mul(FACTOR);
    }
}

impl Hasher for NumberHasher {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 32)
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.mix(u64::from(*byte)));
    }

    fn write_u32(&mut self, word: u32) {
        self.mix(u64::from(word));
    }

    fn write_u64(&mut self, word: u64) {
        self.mix(word);
    }

    fn write_u128(&mut self, word: u128) {
        self.mix(word as u64);
        self.mix((word >> 64) as u64);
    }

    fn write_usize(&mut self, word: usize) {
        self.mix(word as u64);
    }
}

/// Returns a hash of words.
pub(super) fn words<W: Copy + Into<u64>>(words: &[W]) -> u64 {
    let mut hasher = NumberHasher::default();
    words.iter().for_each(|word| hasher.mix((*word).into()));
    hasher.finish()
}
