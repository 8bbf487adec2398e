//! The facts that hold: those of the initial state, of which there may be millions, and what has changed since.

use std::collections::HashSet;
use std::hash::BuildHasher as _;

use crate::formats::pddl::Seeded;

/// A predicate with its arguments, by their numbers.
type Ground = Box<[u32]>;

/// A free place.
const FREE: u32 = u32::MAX;

/// Where the facts of an initial state are in their list. It is made once, however many plans are simulated.
#[derive(Debug, Clone)]
pub(super) struct FactTable {
    hasher: Seeded,
    /// Open addressing; a power of two of places, at most half of which are taken.
    places: Vec<u32>,
}

impl FactTable {
    pub(super) fn new(facts: &[Ground]) -> Self {
        let mut table = Self { hasher: Seeded::default(), places: vec![FREE; (facts.len() * 2).next_power_of_two()] };
        for (number, fact) in (0_u32..).zip(facts) {
            let place = table.place(facts, fact);
            if let Some(place) = table.places.get_mut(place).filter(|place| **place == FREE) {
                *place = number;
            }
        }
        table
    }

    /// Where a fact is, or would be.
    fn place(&self, facts: &[Ground], fact: &[u32]) -> usize {
        let mask = self.places.len() - 1;
        let mut place = self.hasher.hash_one(fact) as usize & mask;
        while self.number(place).is_some_and(|number| facts.get(number).is_some_and(|other| other.as_ref() != fact)) {
            place = (place + 1) & mask;
        }
        place
    }

    fn number(&self, place: usize) -> Option<usize> {
        self.places.get(place).filter(|number| **number != FREE).map(|number| *number as usize)
    }
}

/// A set of facts.
#[derive(Clone)]
pub(super) struct Facts<'a> {
    initial: &'a [Ground],
    table: &'a FactTable,
    /// Facts of the initial state that do not hold any more.
    gone: HashSet<Ground, Seeded>,
    /// Other facts that hold.
    new: HashSet<Ground, Seeded>,
}

impl<'a> Facts<'a> {
    /// The facts of an initial state, with their table.
    pub(super) fn new(initial: &'a [Ground], table: &'a FactTable) -> Self {
        Self { initial, table, gone: HashSet::default(), new: HashSet::default() }
    }

    fn is_initial(&self, fact: &[u32]) -> bool {
        self.table.number(self.table.place(self.initial, fact)).is_some()
    }

    pub(super) fn contains(&self, fact: &[u32]) -> bool {
        self.new.contains(fact) || self.is_initial(fact) && !self.gone.contains(fact)
    }

    pub(super) fn insert(&mut self, fact: Ground) {
        self.gone.remove(&fact);
        if !self.is_initial(&fact) {
            self.new.insert(fact);
        }
    }

    pub(super) fn remove(&mut self, fact: &Ground) {
        self.new.remove(fact);
        if self.is_initial(fact) {
            self.gone.insert(fact.clone());
        }
    }

    /// All of them, each once, in no order.
    pub(super) fn iter(&self) -> impl Iterator<Item = &[u32]> {
        let initial = (0..self.table.places.len()).filter_map(|place| self.initial.get(self.table.number(place)?));
        initial.filter(|fact| !self.gone.contains(*fact)).chain(&self.new).map(AsRef::as_ref)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn facts_are_as_those_of_a_plain_set(
            initial in prop::collection::vec(prop::collection::vec(0_u32..4, 1..4), 0..30),
            changes in prop::collection::vec((any::<bool>(), prop::collection::vec(0_u32..4, 1..4)), 0..30),
        ) {
            let initial: Vec<Ground> = initial.into_iter().map(Vec::into_boxed_slice).collect();
            let mut plain: HashSet<Ground> = initial.iter().cloned().collect();
            let table = FactTable::new(&initial);
            let mut facts = Facts::new(&initial, &table);
            for (holds, fact) in changes {
                let fact = fact.into_boxed_slice();
                if holds {
                    facts.insert(fact.clone());
                    plain.insert(fact.clone());
                } else {
                    facts.remove(&fact);
                    plain.remove(&fact);
                }
                prop_assert_eq!(facts.contains(&fact), holds);
            }
            prop_assert!(plain.iter().all(|fact| facts.contains(fact)));
            let (listed, all): (HashSet<Ground>, Vec<Ground>) = (facts.iter().map(Into::into).collect(), facts.iter().map(Into::into).collect());
            prop_assert_eq!((all.len(), listed), (plain.len(), plain));
        }
    }
}
