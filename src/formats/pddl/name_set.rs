//! Many names in little memory.

use std::cell::Cell;
use std::hash::{BuildHasher as _, RandomState};

/// What is set in each byte of a name before it is hashed: it makes lower-case letters of upper-case ones. Few other
/// characters become equal by it, and names are compared after all.
const LOWER_CASE: u64 = 0x2020_2020_2020_2020;
/// How many bits of the place where a name begins are kept with it: four bytes are enough for any problem that is not
/// larger than 4 GiB. The tests have larger ones, in this sense.
const PLACE_BITS: u32 = if cfg!(test) { 8 } else { 32 };
/// How many names that were asked for last are remembered.
const RECENT: usize = 3;

/// Names, each once, compared without regard to case, and kept in the spelling in which they came first.
///
/// A name takes its letters and some 16 bytes: problems have millions of them.
#[derive(Debug, Clone)]
pub struct NameSet {
    /// All names, one after the other.
    text: String,
    /// Where each one begins in the text: the lowest [`PLACE_BITS`] of it.
    starts: Vec<u32>,
    /// The names at which the other bits of that grow by one, by number; one is there again where they grow by more.
    turns: Vec<usize>,
    /// By the names' hashes: the hash and the number of the name plus one; zero where there is none. A power
    /// of two of them, never full.
    slots: Vec<(u32, u32)>,
    /// The names that were found last. Names often come in the order in which they were added, or again, and are
    /// found there without a look at the slots, which lie far from each other in memory.
    recent: Cell<[usize; RECENT]>,
    /// Seeded anew in each process, so that no input can be written whose names all have equal hashes.
    seeds: (u64, u64),
}

impl Default for NameSet {
    fn default() -> Self {
        let random = RandomState::new();
        Self {
            text: String::new(),
            starts: Vec::new(),
            turns: Vec::new(),
            slots: Vec::new(),
            recent: Cell::default(),
            seeds: (random.hash_one(0), random.hash_one(1) | 1),
        }
    }
}

impl NameSet {
    /// Adds a name and returns its number, counted from 0.
    ///
    /// # Errors
    /// The number of the name that is there already, perhaps in another case.
    pub fn add(&mut self, name: &str) -> Result<usize, usize> {
        if self.starts.len() >= self.slots.len() / 4 * 3 {
            self.grow();
        }
        let hash = self.hash(name);
        let slot = match self.slot(name, hash) {
            Ok(number) => return Err(number),
            Err(slot) => slot,
        };
        let number = self.starts.len();
        let start = self.text.len() as u64;
        self.starts.push((start & low_bits()) as u32);
        while (self.turns.len() as u64) < start >> PLACE_BITS {
            self.turns.push(number);
        }
        self.text.push_str(name);
        self.put(slot, hash, number);
        Ok(number)
    }

    /// Returns the number of a name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<usize> {
        self.guess(name).or_else(|| self.look(name))
    }

    /// Returns the number of a name that was added in this very spelling.
    #[must_use]
    pub fn find_exact(&self, name: &str) -> Option<usize> {
        self.guess(name).or_else(|| self.look(name).filter(|number| self.bytes(*number) == Some(name.as_bytes())))
    }

    fn look(&self, name: &str) -> Option<usize> {
        self.slot(name, self.hash(name)).ok().inspect(|number| self.remember(RECENT - 1, *number))
    }

    /// The number of a name that is one of those that were found last, or the next after one of them.
    fn guess(&self, name: &str) -> Option<usize> {
        let is = |number: &usize| self.bytes(*number) == Some(name.as_bytes());
        let mut recent = self.recent.get().into_iter().enumerate();
        let (place, number) =
            recent.find_map(|(place, number)| [number, number + 1].into_iter().find(is).map(|found| (place, found)))?;
        self.remember(place, number);
        Some(number)
    }

    /// Puts a name in front of those that were found last, one of which goes.
    fn remember(&self, gone: usize, number: usize) {
        let mut recent = self.recent.get();
        if let Some(part) = recent.get_mut(..=gone) {
            part.rotate_right(1);
            part.first_mut().into_iter().for_each(|first| *first = number);
        }
        self.recent.set(recent);
    }

    /// Returns the name with a number, as it was added.
    #[must_use]
    pub fn get(&self, number: usize) -> Option<&str> {
        std::str::from_utf8(self.bytes(number)?).ok()
    }

    fn bytes(&self, number: usize) -> Option<&[u8]> {
        let (start, end) = (self.start(number)?, self.start(number + 1).unwrap_or(self.text.len()));
        self.text.as_bytes().get(start..end)
    }

    /// Where a name begins in the text.
    fn start(&self, number: usize) -> Option<usize> {
        let low = u64::from(*self.starts.get(number)?);
        let high = match self.turns.is_empty() {
            true => 0,
            false => self.turns.partition_point(|turn| *turn <= number) as u64,
        };
        usize::try_from(high << PLACE_BITS | low).ok()
    }

    /// Returns how many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.starts.len()
    }

    /// Returns whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.starts.is_empty()
    }

    /// The number of a name; else the free slot for it.
    fn slot(&self, name: &str, hash: u32) -> Result<usize, usize> {
        let mask = self.slots.len().wrapping_sub(1);
        let mut at = hash as usize & mask;
        loop {
            match self.slots.get(at).copied() {
                None | Some((_, 0)) => return Err(at),
                Some((known, entry)) if known == hash => {
                    let number = entry as usize - 1;
                    if self.bytes(number).is_some_and(|known| known.eq_ignore_ascii_case(name.as_bytes())) {
                        return Ok(number);
                    }
                }
                Some(_) => {}
            }
            at = (at + 1) & mask;
        }
    }

    fn put(&mut self, slot: usize, hash: u32, number: usize) {
        let entry = u32::try_from(number + 1).unwrap_or(u32::MAX);
        self.slots.get_mut(slot).into_iter().for_each(|slot| *slot = (hash, entry));
    }

    fn grow(&mut self) {
        let size = (self.slots.len() * 2).max(64);
        let before = std::mem::replace(&mut self.slots, vec![(0, 0); size]);
        for (hash, entry) in before.into_iter().filter(|(_, entry)| *entry != 0) {
            let free = self.free(hash);
            self.slots.get_mut(free).into_iter().for_each(|slot| *slot = (hash, entry));
        }
    }

    /// The free slot for a name that has none yet.
    fn free(&self, hash: u32) -> usize {
        let mask = self.slots.len().wrapping_sub(1);
        let mut at = hash as usize & mask;
        while self.slots.get(at).is_some_and(|(_, entry)| *entry != 0) {
            at = (at + 1) & mask;
        }
        at
    }

    /// The hash of a name, in whatever case: eight bytes at a time are multiplied by a secret number, and the two halves
    /// of the product combined. SipHash takes longer for names, which are short.
    fn hash(&self, name: &str) -> u32 {
        let (seed, secret) = self.seeds;
        let mixed = |hash: u64, word: u64| {
            let product = u128::from(hash ^ (word | LOWER_CASE)) * u128::from(secret);
            (product as u64) ^ ((product >> 64) as u64)
        };
        let bytes = name.as_bytes();
        let (words, rest) = bytes.as_chunks::<8>();
        let hash = words.iter().fold(seed ^ bytes.len() as u64, |hash, word| mixed(hash, u64::from_le_bytes(*word)));
        // The last eight bytes, some of them once more; of a shorter name, all.
        let last = match bytes.last_chunk::<8>() {
            Some(last) => u64::from_le_bytes(*last),
            None => rest.iter().fold(0, |word, byte| word << 8 | u64::from(*byte)),
        };
        let hash = mixed(hash, last);
        (hash ^ (hash >> 32)) as u32
    }
}

/// The bits of a place that are kept with each name.
const fn low_bits() -> u64 {
    (1 << PLACE_BITS) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_in_any_case_and_kept_in_their_first() {
        let mut names = NameSet::default();
        assert_eq!(names.find("a"), None);
        for number in 0..1000 {
            assert_eq!(names.add(&format!("Name{number}")), Ok(number));
        }
        assert_eq!(names.add("nAME7"), Err(7));
        assert_eq!((names.find("NAME999"), names.find("name1000")), (Some(999), None));
        assert_eq!((names.find_exact("NAME999"), names.find_exact("Name7")), (None, Some(7)));
        assert_eq!((names.get(0), names.get(999), names.get(1000)), (Some("Name0"), Some("Name999"), None));
        assert_eq!(names.len(), 1000);
    }

    #[test]
    fn a_name_is_found_after_one_of_any_length() {
        let mut names = NameSet::default();
        let lengths = [1, 255, 256, 257, 0, 700, 3, 65_536, 2];
        let name = |number: usize, length: usize| format!("{number}{}", "x".repeat(length));
        for (number, length) in lengths.into_iter().enumerate() {
            assert_eq!(names.add(&name(number, length)), Ok(number));
        }
        for (number, length) in lengths.into_iter().enumerate() {
            assert_eq!(names.get(number), Some(name(number, length).as_str()));
            assert_eq!(names.find(&name(number, length)), Some(number));
        }
    }

    #[test]
    fn names_are_found_in_whatever_order_they_are_asked_for() {
        let mut names = NameSet::default();
        for number in 0..500 {
            assert_eq!(names.add(&format!("a{number}")), Ok(number));
        }
        for step in [0, 1, 2, 7, 499] {
            for nth in 0..1_500 {
                let number = nth * step % 500;
                assert_eq!(names.find(&format!("a{number}")), Some(number));
                assert_eq!(names.find(&format!("A{}", 499 - number)), Some(499 - number));
                assert_eq!((names.find("a500"), names.find("")), (None, None));
            }
        }
    }
}
