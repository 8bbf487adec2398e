//! Facts by predicate, and by what is known of their arguments.

use std::cell::OnceCell;
use std::collections::HashMap;
use std::ops::Range;

use super::state::{Bindings, Ground, UNBOUND};
use crate::pddl::model::{Arg, Fact};

/// The facts of the predicates that are looked at, in the order in which they came.
#[derive(Default)]
pub(super) struct Index {
    tables: HashMap<u32, Table>,
}

/// The facts of one predicate.
#[derive(Default)]
struct Table {
    facts: Vec<Ground>,
    /// The places of the facts by the object at a position, made when it is asked for.
    by_argument: Vec<OnceCell<HashMap<u32, Vec<usize>>>>,
}

impl Index {
    /// Facts of this predicate are kept from now on.
    pub(super) fn watch(&mut self, predicate: u32) {
        self.tables.entry(predicate).or_default();
    }

    /// The predicates whose facts are kept.
    pub(super) fn predicates(&self) -> impl Iterator<Item = u32> {
        self.tables.keys().copied()
    }

    /// How many facts of a predicate there are.
    pub(super) fn count(&self, predicate: u32) -> usize {
        self.tables.get(&predicate).map_or(0, |table| table.facts.len())
    }

    /// Keeps a fact if its predicate is watched.
    pub(super) fn add(&mut self, fact: &[u32]) {
        if let Some(table) = fact.first().and_then(|predicate| self.tables.get_mut(predicate)) {
            table.add(fact.into());
        }
    }

    /// Puts the facts in order.
    pub(super) fn sort(&mut self) {
        for table in self.tables.values_mut() {
            table.by_argument.iter_mut().for_each(|by_object| drop(by_object.take()));
            table.facts.sort_unstable();
        }
    }

    /// The facts that may be this one, given the objects that are known: the fewest that one argument leaves.
    pub(super) fn candidates(&self, fact: &Fact, range: Range<usize>, bindings: &Bindings) -> Candidates<'_> {
        let Some(table) = self.tables.get(&fact.predicate) else { return Candidates::default() };
        let mut best = Candidates { facts: table.facts.get(range.clone()).unwrap_or_default(), places: None, all: &[] };
        for (position, argument) in fact.arguments.iter().enumerate() {
            let object = match argument {
                Arg::Object(number) => *number,
                Arg::Slot(slot) => bindings.get(*slot as usize).copied().unwrap_or(UNBOUND),
                Arg::Fluent => UNBOUND,
            };
            if object == UNBOUND || best.len() < 2 {
                continue;
            }
            let list = table.places(position, object);
            let place = |number: usize| list.partition_point(|other| *other < number);
            let list = list.get(place(range.start)..place(range.end)).unwrap_or_default();
            if list.len() < best.len() {
                best = Candidates { facts: &[], places: Some(list), all: &table.facts };
            }
        }
        best
    }
}

impl Table {
    fn add(&mut self, fact: Ground) {
        for (by_object, object) in self.by_argument.iter_mut().zip(fact.iter().skip(1)) {
            if let Some(by_object) = by_object.get_mut() {
                by_object.entry(*object).or_default().push(self.facts.len());
            }
        }
        self.facts.push(fact);
        if self.by_argument.is_empty() {
            let arity = self.facts.first().map_or(0, |fact| fact.len().saturating_sub(1));
            self.by_argument.resize_with(arity, OnceCell::new);
        }
    }

    /// The places of the facts with an object at a position, ascending.
    fn places(&self, position: usize, object: u32) -> &[usize] {
        let by_object = self.by_argument.get(position).map(|cell| {
            cell.get_or_init(|| {
                let mut by_object: HashMap<u32, Vec<usize>> = HashMap::new();
                for (place, fact) in self.facts.iter().enumerate() {
                    if let Some(object) = fact.get(position + 1) {
                        by_object.entry(*object).or_default().push(place);
                    }
                }
                by_object
            })
        });
        by_object.and_then(|by_object| by_object.get(&object)).map_or(&[], Vec::as_slice)
    }
}

/// Some facts of one predicate.
#[derive(Default)]
pub(super) struct Candidates<'i> {
    facts: &'i [Ground],
    /// The places of the facts among `all`, where they are not next to each other.
    places: Option<&'i [usize]>,
    all: &'i [Ground],
}

impl<'i> Candidates<'i> {
    pub(super) fn len(&self) -> usize {
        self.places.map_or(self.facts.len(), <[usize]>::len)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &'i Ground> {
        let all = self.all;
        let picked = self.places.unwrap_or_default().iter().filter_map(move |place| all.get(*place));
        self.facts.iter().chain(picked)
    }
}
