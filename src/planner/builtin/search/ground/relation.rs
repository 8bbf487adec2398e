//! Sets of tuples of objects, with indexes for joins.

use super::super::hash::NumberMap;
use super::super::lifted::Object;

/// Some objects of a tuple, packed side by side.
pub(super) type Key = u128;

/// The tuples of one predicate, in the order in which they were found.
///
/// A tuple is visible to joins once it was [shown](Relations::show): so each pair of tuples meets once.
#[derive(Debug, Default)]
pub(super) struct Relation {
    arity: usize,
    /// Whether nothing is added twice, so that no check is needed.
    is_distinct: bool,
    count: u32,
    tuples: Vec<Object>,
    visible: usize,
    ids: NumberMap<Key, u32>,
    /// By the positions whose objects are given, as bits.
    indexes: Vec<(u32, NumberMap<Key, Vec<u32>>)>,
}

impl Relation {
    /// Returns how many tuples there are.
    pub(super) fn len(&self) -> usize {
        self.count as usize
    }

    /// Returns a tuple.
    pub(super) fn tuple(&self, id: u32) -> &[Object] {
        let start = id as usize * self.arity;
        &self.tuples[start..start + self.arity]
    }
}

/// Relations by number.
#[derive(Debug)]
pub(super) struct Relations {
    bits: u32,
    relations: Vec<Relation>,
}

impl Relations {
    /// Makes empty relations of these arities over so many objects, and says to which of them nothing is added
    /// twice. `None` where the tuples of one do not fit a key.
    pub(super) fn new(objects: usize, arities: impl Iterator<Item = (usize, bool)>) -> Option<Self> {
        let bits = usize::BITS - objects.max(2).leading_zeros();
        let relations: Vec<_> =
            arities.map(|(arity, is_distinct)| Relation { arity, is_distinct, ..Relation::default() }).collect();
        let fits = relations.iter().all(|relation| relation.arity <= 32 && relation.arity * bits as usize <= 128);
        fits.then_some(Self { bits, relations })
    }

    pub(super) fn get(&self, relation: usize) -> &Relation {
        &self.relations[relation]
    }

    pub(super) fn key(&self, objects: impl Iterator<Item = Object>) -> Key {
        objects.fold(0, |key, object| key << self.bits | Key::from(object))
    }

    /// Returns the number of a tuple that is there, visible or not.
    pub(super) fn find(&self, relation: usize, tuple: impl Iterator<Item = Object>) -> Option<u32> {
        self.relations[relation].ids.get(&self.key(tuple)).copied()
    }

    /// Adds a tuple; `None` where it was there.
    pub(super) fn insert(&mut self, relation: usize, tuple: &[Object]) -> Option<u32> {
        let key = self.key(tuple.iter().copied());
        let relation = &mut self.relations[relation];
        let next = relation.count;
        if !relation.is_distinct && *relation.ids.entry(key).or_insert(next) != next {
            return None;
        }
        relation.count += 1;
        relation.tuples.extend_from_slice(tuple);
        Some(next)
    }

    /// Makes the next tuple visible.
    pub(super) fn show(&mut self, number: usize) {
        let (bits, relation) = (self.bits, &mut self.relations[number]);
        let id = relation.visible as u32;
        relation.visible += 1;
        let start = id as usize * relation.arity;
        let tuple = &relation.tuples[start..start + relation.arity];
        for (mask, index) in &mut relation.indexes {
            index.entry(masked(tuple, *mask, bits)).or_default().push(id);
        }
    }

    /// Returns how many visible tuples have the objects of the key at the positions of the mask.
    pub(super) fn count(&mut self, number: usize, mask: u32, key: Key) -> usize {
        let relation = &self.relations[number];
        if mask == 0 {
            return relation.visible;
        }
        if !relation.is_distinct && mask.count_ones() as usize == relation.arity {
            return usize::from(relation.ids.get(&key).is_some_and(|id| (*id as usize) < relation.visible));
        }
        self.index(number, mask).get(&key).map_or(0, Vec::len)
    }

    /// Appends the visible tuples that [`Self::count`] counts.
    pub(super) fn select(&mut self, number: usize, mask: u32, key: Key, ids: &mut Vec<u32>) {
        let relation = &self.relations[number];
        if mask == 0 {
            ids.extend(0..relation.visible as u32);
        } else if !relation.is_distinct && mask.count_ones() as usize == relation.arity {
            ids.extend(relation.ids.get(&key).copied().filter(|id| (*id as usize) < relation.visible));
        } else if let Some(found) = self.index(number, mask).get(&key) {
            ids.extend_from_slice(found);
        }
    }

    /// The index for a mask, made when it is first wanted.
    fn index(&mut self, number: usize, mask: u32) -> &NumberMap<Key, Vec<u32>> {
        let bits = self.bits;
        let relation = &mut self.relations[number];
        let place = match relation.indexes.iter().position(|(known, _)| *known == mask) {
            Some(place) => place,
            None => {
                let mut index: NumberMap<Key, Vec<u32>> = NumberMap::default();
                for id in 0..relation.visible {
                    let tuple = &relation.tuples[id * relation.arity..(id + 1) * relation.arity];
                    index.entry(masked(tuple, mask, bits)).or_default().push(id as u32);
                }
                relation.indexes.push((mask, index));
                relation.indexes.len() - 1
            }
        };
        &relation.indexes[place].1
    }
}

fn masked(tuple: &[Object], mask: u32, bits: u32) -> Key {
    let given = tuple.iter().enumerate().filter(|(position, _)| mask >> position & 1 == 1);
    given.fold(0, |key, (_, object)| key << bits | Key::from(*object))
}
