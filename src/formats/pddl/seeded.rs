//! A hash function for short names and tuples of numbers, which problems have by the million.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::sync::OnceLock;

/// Makes [`SeededHasher`]s; the seeds are drawn once for each process, so that no input can be written whose keys all have
/// equal hashes.
#[derive(Debug, Clone)]
pub struct Seeded {
    seed: u64,
    secret: u64,
}

impl Default for Seeded {
    fn default() -> Self {
        static SEEDS: OnceLock<Seeded> = OnceLock::new();
        let draw = || {
            let random = RandomState::new();
            Self { seed: random.hash_one(0), secret: random.hash_one(1) | 1 }
        };
        SEEDS.get_or_init(draw).clone()
    }
}

impl BuildHasher for Seeded {
    type Hasher = SeededHasher;

    fn build_hasher(&self) -> SeededHasher {
        SeededHasher { hash: self.seed, secret: self.secret }
    }
}

/// Multiplies eight bytes at a time by a secret number, and combines the two halves of the product. SipHash takes longer
/// for keys that are short.
#[derive(Debug, Clone)]
pub struct SeededHasher {
    hash: u64,
    secret: u64,
}

impl SeededHasher {
    fn mix(&mut self, word: u64) {
        let product = u128::from(self.hash ^ word) * u128::from(self.secret);
        self.hash = (product as u64) ^ ((product >> 64) as u64);
    }
}

impl Hasher for SeededHasher {
    fn write(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<8>();
        words.iter().for_each(|word| self.mix(u64::from_le_bytes(*word)));
        // The length tells apart keys whose last bytes are zeros.
        let length = (bytes.len() as u64) << 56;
        let rest = match (rest.first_chunk::<4>(), rest.last_chunk::<4>()) {
            (Some(first), Some(last)) => {
                u64::from(u32::from_le_bytes(*first)) << 24 ^ u64::from(u32::from_le_bytes(*last))
            }
            _ => rest.iter().fold(0, |word, byte| word << 8 | u64::from(*byte)),
        };
        self.mix(rest ^ length);
    }

    fn write_u8(&mut self, number: u8) {
        self.mix(u64::from(number));
    }

    fn write_u32(&mut self, number: u32) {
        self.mix(u64::from(number));
    }

    fn write_u64(&mut self, number: u64) {
        self.mix(number);
    }

    fn write_usize(&mut self, number: usize) {
        self.mix(number as u64);
    }

    fn finish(&self) -> u64 {
        self.hash
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn keys_that_differ_have_hashes_that_differ() {
        let seeded = Seeded::default();
        let mut hashes = HashSet::new();
        for number in 0..10_000_u32 {
            assert!(hashes.insert(seeded.hash_one(format!("a{number}"))), "a{number}");
            assert!(hashes.insert(seeded.hash_one([number, 3, 7].as_slice())), "{number}");
            assert!(hashes.insert(seeded.hash_one([3, number].as_slice())), "{number}");
        }
        for length in 0..20 {
            assert!(hashes.insert(seeded.hash_one(vec![0_u8; length].as_slice())), "{length} zeros");
        }
        assert_eq!(seeded.hash_one("a b"), Seeded::default().hash_one("a b"));
    }

    #[test]
    fn numbers_one_after_the_other_fall_into_places_far_apart() {
        // As many keys as places: about 37 of 100 stay empty where places are drawn at random. The seeds are fixed, so that
        // no draw of them fails the test.
        for (seed, secret) in
            [(0x243f_6a88_85a3_08d3, 0x1319_8a2e_0370_7345), (0xa409_3822_299f_31d0, 0x082e_fa98_ec4e_6c89)]
        {
            let seeded = Seeded { seed, secret };
            let hash = |number: u32| seeded.hash_one([5, number].as_slice());
            let places: HashSet<u64> = (0..4096).map(|number| hash(number) % 4096).collect();
            assert!((2300..2900).contains(&places.len()), "{}", places.len());
        }
    }
}
