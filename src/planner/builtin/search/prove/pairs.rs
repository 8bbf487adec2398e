//! Pairs of facts, as a row of bits for each fact.

use super::super::task::Fact;

/// A set of pairs; a pair of a fact with itself says that the fact is possible.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pairs {
    words: usize,
    bits: Vec<u64>,
}

impl Pairs {
    /// No pairs of so many facts.
    pub(super) fn none(facts: usize) -> Self {
        let words = facts.div_ceil(64);
        Self { words, bits: vec![0; words * facts] }
    }

    /// Returns how many words a row has.
    pub(super) fn words(&self) -> usize {
        self.words
    }

    pub(super) fn has(&self, one: Fact, other: Fact) -> bool {
        contains(self.row(one), other)
    }

    /// The facts that a fact is in a pair with.
    pub(super) fn row(&self, fact: Fact) -> &[u64] {
        &self.bits[fact as usize * self.words..][..self.words]
    }

    /// Adds a pair; says whether it was not there.
    pub(super) fn add(&mut self, one: Fact, other: Fact) -> bool {
        let is_new = insert(self.row_mut(one), other);
        insert(self.row_mut(other), one);
        is_new
    }

    fn row_mut(&mut self, fact: Fact) -> &mut [u64] {
        &mut self.bits[fact as usize * self.words..][..self.words]
    }

    /// Whether all pairs of these facts are there, those of each with itself among them.
    pub(super) fn has_all(&self, facts: &[Fact]) -> bool {
        facts.iter().enumerate().all(|(place, fact)| facts[place..].iter().all(|other| self.has(*fact, *other)))
    }

    /// Removes the pairs of another set.
    pub(super) fn remove_all(&mut self, other: &Self) {
        self.bits.iter_mut().zip(&other.bits).for_each(|(word, gone)| *word &= !gone);
    }

    /// The facts that are possible.
    pub(super) fn single(&self) -> Vec<u64> {
        let mut set = vec![0; self.words];
        let facts = (self.bits.len() / self.words.max(1)) as Fact;
        (0..facts).filter(|fact| self.has(*fact, *fact)).for_each(|fact| _ = insert(&mut set, fact));
        set
    }

    /// Keeps of `found` what is in a pair with each of these facts.
    pub(super) fn meet(&self, facts: &[Fact], found: &mut [u64]) {
        for fact in facts {
            found.iter_mut().zip(self.row(*fact)).for_each(|(word, row)| *word &= row);
        }
    }
}

/// Whether a fact is in a set.
pub(super) fn contains(set: &[u64], fact: Fact) -> bool {
    set[fact as usize / 64] >> (fact % 64) & 1 == 1
}

/// Adds a fact to a set; says whether it was not there.
pub(super) fn insert(set: &mut [u64], fact: Fact) -> bool {
    let (word, bit) = (&mut set[fact as usize / 64], 1 << (fact % 64));
    let is_new = *word & bit == 0;
    *word |= bit;
    is_new
}

/// Removes facts from a set.
pub(super) fn remove(set: &mut [u64], facts: std::ops::Range<Fact>) {
    facts.for_each(|fact| set[fact as usize / 64] &= !(1 << (fact % 64)));
}

/// The facts of a set, in order.
pub(super) fn facts(set: &[u64]) -> impl Iterator<Item = Fact> + '_ {
    set.iter().enumerate().flat_map(|(place, word)| {
        let mut left = *word;
        std::iter::from_fn(move || {
            let bit = (left != 0).then(|| left.trailing_zeros())?;
            left &= left - 1;
            Some((place * 64) as Fact + bit)
        })
    })
}
