//! Invariants: sets of atoms of which at most one is true at a time.
//!
//! A candidate takes atoms of some predicates, and of those the ones that agree on its parameters; one argument of
//! each may be counted. As in Helmert (2009, section 5), a candidate is balanced if whatever adds one of its atoms
//! deletes another one that it needs, and a candidate that is not is refined by the predicates that would balance
//! it. Unlike there, balance is decided for the ground operators, and for each instance of a candidate by itself.

use std::collections::HashSet;

use super::super::hash::NumberMap;
use super::super::lifted::Object;
use super::formula::{Atoms, Literal};
use super::instance::{Instances, Operator};
use super::reach::Reached;

/// Most candidates that are looked at.
const CANDIDATES: usize = 300;

/// Most changes that are looked at for all candidates.
const WORK: usize = 60_000_000;

/// Which atoms of a predicate a candidate has.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Part {
    predicate: usize,
    /// The position of each parameter.
    parameters: Vec<usize>,
}

/// No group.
const NONE: u32 = u32::MAX;

pub(super) struct Finder<'a> {
    reached: &'a Reached<'a>,
    instances: &'a Instances,
    /// The predicate and the objects of each atom that matters.
    tuples: Vec<Option<(usize, &'a [Object])>>,
    /// The atoms of each predicate.
    members: Vec<Vec<u32>>,
    /// The operators that add an atom of a predicate.
    adders: Vec<Vec<u32>>,
    work: usize,
}

impl<'a> Finder<'a> {
    pub(super) fn new(reached: &'a Reached<'a>, atoms: &Atoms, instances: &'a Instances, is_relevant: &[bool]) -> Self {
        let predicates = reached.lifted.predicates.len();
        let mut is_derived = vec![false; instances.init.len()];
        instances.axioms.iter().for_each(|axiom| is_derived[axiom.head as usize] = true);
        let mut tuples = Vec::new();
        let mut members = vec![Vec::new(); predicates];
        for atom in 0..instances.init.len() {
            let wanted = is_relevant[atom] && !is_derived[atom];
            let tuple = wanted.then(|| atoms.tuple(reached, atom as u32)).flatten();
            if let Some((predicate, _)) = tuple {
                members[predicate].push(atom as u32);
            }
            tuples.push(tuple);
        }
        let mut adders: Vec<Vec<u32>> = vec![Vec::new(); predicates];
        for (number, operator) in instances.operators.iter().enumerate() {
            for change in operator.changes.iter().filter(|change| change.adds) {
                if let Some((predicate, _)) = tuples[change.atom as usize]
                    && adders[predicate].last() != Some(&(number as u32))
                {
                    adders[predicate].push(number as u32);
                }
            }
        }
        Self { reached, instances, tuples, members, adders, work: WORK }
    }

    /// Returns sets of two atoms or more.
    pub(super) fn groups(mut self) -> Vec<Vec<u32>> {
        let mut groups = Vec::new();
        let mut queue: Vec<Vec<Part>> = Vec::new();
        for (predicate, members) in self.members.iter().enumerate().filter(|(_, members)| !members.is_empty()) {
            let arity =
                members.first().and_then(|atom| self.tuples[*atom as usize]).map_or(0, |(_, tuple)| tuple.len());
            queue.push(vec![Part { predicate, parameters: (0..arity).collect() }]);
            for counted in 0..arity {
                let parameters = (0..arity).filter(|position| *position != counted).collect();
                queue.push(vec![Part { predicate, parameters }]);
            }
        }
        let mut seen: HashSet<Vec<Part>> = queue.iter().cloned().collect();
        let mut next = 0;
        while next < queue.len().min(CANDIDATES) && self.work > 0 {
            for refined in self.check(&queue[next].clone(), &mut groups) {
                if seen.insert(refined.clone()) {
                    queue.push(refined);
                }
            }
            next += 1;
        }
        groups
    }

    /// Checks the instances of a candidate; returns how it may be refined.
    fn check(&mut self, candidate: &[Part], groups: &mut Vec<Vec<u32>>) -> Vec<Vec<Part>> {
        let mut group_of = vec![NONE; self.tuples.len()];
        let mut members: Vec<Vec<u32>> = Vec::new();
        let mut numbers: NumberMap<u128, u32> = NumberMap::default();
        for part in candidate {
            for atom in &self.members[part.predicate] {
                let Some((_, tuple)) = self.tuples[*atom as usize] else { continue };
                let key = self.reached.relations.key(part.parameters.iter().map(|position| tuple[*position]));
                let number = *numbers.entry(key).or_insert(members.len() as u32);
                if number as usize == members.len() {
                    members.push(Vec::new());
                }
                group_of[*atom as usize] = number;
                members[number as usize].push(*atom);
            }
        }
        let initially = |group: &Vec<u32>| group.iter().filter(|atom| self.instances.init[**atom as usize]).count();
        let mut is_dead: Vec<bool> = members.iter().map(|group| initially(group) > 1).collect();
        let mut refined = Vec::new();
        let mut blamed: Vec<usize> = Vec::new();
        let mut adders: Vec<u32> =
            candidate.iter().flat_map(|part| self.adders[part.predicate].iter().copied()).collect();
        if candidate.len() > 1 {
            adders.sort_unstable();
            adders.dedup();
        }
        for number in adders {
            let operator = &self.instances.operators[number as usize];
            self.work = self.work.saturating_sub(operator.changes.len());
            for (place, change) in operator.changes.iter().enumerate().filter(|(_, change)| change.adds) {
                let group = group_of[change.atom as usize];
                if group == NONE || is_dead[group as usize] {
                    continue;
                }
                let is_heavy = operator.changes[place + 1..]
                    .iter()
                    .any(|other| other.adds && other.atom != change.atom && group_of[other.atom as usize] == group);
                let knows = |literal: Literal| {
                    operator.condition.binary_search(&literal).is_ok()
                        || change.condition.binary_search(&literal).is_ok()
                };
                if is_heavy {
                    is_dead[group as usize] = true;
                } else if !knows(change.atom << 1)
                    && !deleted(operator, &knows).any(|atom| group_of[atom as usize] == group)
                {
                    is_dead[group as usize] = true;
                    // One operator of a schema shows what would balance it.
                    if !blamed.contains(&operator.schema) {
                        blamed.push(operator.schema);
                        let part = candidate.iter().find(|part| {
                            self.tuples[change.atom as usize].is_some_and(|(predicate, _)| predicate == part.predicate)
                        });
                        for atom in deleted(operator, &knows) {
                            self.refine(candidate, part, change.atom, atom, &mut refined);
                        }
                    }
                }
            }
        }
        let alive = members.into_iter().zip(is_dead).filter(|(group, is_dead)| !is_dead && group.len() > 1);
        groups.extend(alive.map(|(group, _)| group));
        refined
    }

    /// Adds the ways in which the predicate of a deleted atom may join a candidate that an added atom is of.
    fn refine(&self, candidate: &[Part], part: Option<&Part>, added: u32, deleted: u32, refined: &mut Vec<Vec<Part>>) {
        let (Some(part), Some((_, objects)), Some((predicate, tuple))) =
            (part, self.tuples[added as usize], self.tuples[deleted as usize])
        else {
            return;
        };
        let count = part.parameters.len();
        if candidate.iter().any(|part| part.predicate == predicate) || tuple.len() < count || tuple.len() > count + 1 {
            return;
        }
        let mut ways: Vec<Vec<usize>> = vec![Vec::new()];
        for position in &part.parameters {
            let fits = |way: &Vec<usize>, place: &usize| tuple[*place] == objects[*position] && !way.contains(place);
            ways = ways
                .iter()
                .flat_map(|way| {
                    let places = (0..tuple.len()).filter(|place| fits(way, place));
                    places.map(|place| [way.as_slice(), &[place]].concat()).collect::<Vec<_>>()
                })
                .collect();
        }
        for parameters in ways {
            let mut parts = candidate.to_vec();
            parts.push(Part { predicate, parameters });
            // The order of the parameters is arbitrary; that of the parts is not, so that equal candidates are equal.
            parts.sort();
            refined.push(parts);
        }
    }
}

/// The atoms that an operator deletes where it is known that they were true.
fn deleted<'o>(operator: &'o Operator, knows: &'o dyn Fn(Literal) -> bool) -> impl Iterator<Item = u32> + 'o {
    let certain = |literals: &[Literal]| literals.iter().all(|literal| knows(*literal));
    let deletes = operator.changes.iter().filter(|change| !change.adds);
    deletes.filter(move |change| knows(change.atom << 1) && certain(&change.condition)).map(|change| change.atom)
}
