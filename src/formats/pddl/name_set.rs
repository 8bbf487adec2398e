//! Many names in little memory.

use std::hash::{BuildHasher as _, RandomState};

/// Names, each once, compared without regard to case, and kept in the spelling in which they came first.
///
/// A name takes its letters and some 20 bytes: problems have millions of them.
#[derive(Debug, Clone, Default)]
pub struct NameSet {
    /// All names, one after the other.
    text: String,
    /// Where each one begins in the text.
    starts: Vec<usize>,
    /// By the names' hashes: the upper half of the hash and the number of the name plus one; zero where there is none. A power
    /// of two of them, never full.
    slots: Vec<(u32, u32)>,
    hasher: RandomState,
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
        self.starts.push(self.text.len());
        self.text.push_str(name);
        self.put(slot, hash, number);
        Ok(number)
    }

    /// Returns the number of a name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<usize> {
        self.slot(name, self.hash(name)).ok()
    }

    /// Returns the name with a number, as it was added.
    #[must_use]
    pub fn get(&self, number: usize) -> Option<&str> {
        let start = *self.starts.get(number)?;
        let end = self.starts.get(number + 1).copied().unwrap_or(self.text.len());
        self.text.get(start..end)
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
    fn slot(&self, name: &str, hash: u64) -> Result<usize, usize> {
        let mask = self.slots.len().wrapping_sub(1);
        let mut at = hash as usize & mask;
        loop {
            match self.slots.get(at).copied() {
                None | Some((_, 0)) => return Err(at),
                Some((upper, entry)) if upper == upper_half(hash) => {
                    let number = entry as usize - 1;
                    if self.get(number).is_some_and(|known| known == name || known.eq_ignore_ascii_case(name)) {
                        return Ok(number);
                    }
                }
                Some(_) => {}
            }
            at = (at + 1) & mask;
        }
    }

    fn put(&mut self, slot: usize, hash: u64, number: usize) {
        let entry = u32::try_from(number + 1).unwrap_or(u32::MAX);
        self.slots.get_mut(slot).into_iter().for_each(|slot| *slot = (upper_half(hash), entry));
    }

    fn grow(&mut self) {
        let size = (self.slots.len() * 2).max(64);
        self.slots = Vec::new();
        self.slots.resize(size, (0, 0));
        for number in 0..self.starts.len() {
            let Some(hash) = self.get(number).map(|name| self.hash(name)) else { continue };
            self.put(self.free(hash), hash, number);
        }
    }

    /// The free slot for a name that has none yet.
    fn free(&self, hash: u64) -> usize {
        let mask = self.slots.len().wrapping_sub(1);
        let mut at = hash as usize & mask;
        while self.slots.get(at).is_some_and(|(_, entry)| *entry != 0) {
            at = (at + 1) & mask;
        }
        at
    }

    fn hash(&self, name: &str) -> u64 {
        match name.bytes().any(|byte| byte.is_ascii_uppercase()) {
            true => self.hasher.hash_one(name.to_ascii_lowercase().as_bytes()),
            false => self.hasher.hash_one(name.as_bytes()),
        }
    }
}

fn upper_half(hash: u64) -> u32 {
    (hash >> 32) as u32
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
        assert_eq!((names.get(0), names.get(999), names.get(1000)), (Some("Name0"), Some("Name999"), None));
        assert_eq!(names.len(), 1000);
    }
}
