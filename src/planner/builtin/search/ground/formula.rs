//! Conditions over ground atoms, simplified by what never changes and by what is not reachable.

use super::super::hash::NumberMap;
use super::super::lifted::{Amount, Atom, Condition, Object};
use super::super::number::{Comparator, Expression};
use super::ledger::{Ledger, object};
use super::reach::Reached;

/// A ground atom, times two, plus one where it is negated.
pub(super) type Literal = u32;

/// Most conjunctions that a condition is split into. Where there would be more, its disjunctions become derived atoms.
const SPLIT: usize = 4;

/// A formula over ground atoms.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Ground {
    True,
    False,
    Literal(Literal),
    And(Vec<Self>),
    Or(Vec<Self>),
}

/// A ground rule for a derived atom.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct GroundAxiom {
    pub(super) head: u32,
    pub(super) body: Vec<Literal>,
}

/// The numbers of ground atoms.
pub(super) struct Atoms {
    /// The first number of each predicate's; none for those that never change.
    base: Vec<Option<u32>>,
    pub(super) count: u32,
    /// The derived atoms that stand for disjunctions.
    disjunctions: NumberMap<Vec<Vec<Literal>>, u32>,
    pub(super) axioms: Vec<GroundAxiom>,
    pub(super) ledger: Ledger,
}

impl Atoms {
    pub(super) fn new(reached: &Reached<'_>) -> Self {
        let mut count = 0;
        let base = reached.is_fluent.iter().enumerate().map(|(predicate, is_fluent)| {
            let base = count;
            count += if *is_fluent { reached.relations.get(predicate).len() as u32 } else { 0 };
            is_fluent.then_some(base)
        });
        let base = base.collect();
        Self {
            base,
            count,
            disjunctions: NumberMap::default(),
            axioms: Vec::new(),
            ledger: Ledger::new(reached.lifted),
        }
    }

    /// Returns the number of an atom; `None` where it is not reachable.
    pub(super) fn number(&self, reached: &Reached<'_>, atom: &Atom, binding: &[Object]) -> Option<u32> {
        let objects = atom.terms.iter().map(|term| object(*term, binding));
        Some(self.base[atom.predicate]? + reached.relations.find(atom.predicate, objects)?)
    }

    /// Returns the predicate and the objects of an atom; `None` for one that stands for a disjunction.
    pub(super) fn tuple<'r>(&self, reached: &'r Reached<'_>, atom: u32) -> Option<(usize, &'r [Object])> {
        let fluents = self.base.iter().enumerate().filter_map(|(predicate, base)| Some((predicate, (*base)?)));
        let (predicate, base) = fluents
            .take_while(|(_, base)| *base <= atom)
            .filter(|(predicate, base)| ((atom - base) as usize) < reached.relations.get(*predicate).len())
            .last()?;
        Some((predicate, reached.relations.get(predicate).tuple(atom - base)))
    }

    /// Returns a condition for the objects of a binding.
    pub(super) fn ground(
        &mut self,
        reached: &Reached<'_>,
        condition: &Condition,
        binding: &mut [Object],
        slots: &[usize],
    ) -> Ground {
        match condition {
            Condition::True => Ground::True,
            Condition::False => Ground::False,
            Condition::Equal(left, right, negated) => {
                truth((object(*left, binding) == object(*right, binding)) != *negated)
            }
            Condition::Literal(atom, negated) => {
                match (reached.is_fluent[atom.predicate], self.number(reached, atom, binding)) {
                    (true, Some(number)) => Ground::Literal(number << 1 | u32::from(*negated)),
                    (true, None) => truth(*negated),
                    (false, _) => {
                        let objects = atom.terms.iter().map(|term| object(*term, binding));
                        truth(reached.relations.find(atom.predicate, objects).is_some() != *negated)
                    }
                }
            }
            Condition::Compare(comparator, left, right, negated) => {
                self.compare(*comparator, left, right, *negated, binding)
            }
            Condition::And(parts) => self.junction(reached, parts, binding, slots, true),
            Condition::Or(parts) => self.junction(reached, parts, binding, slots, false),
            Condition::Forall(variables, inner) => self.quantifier(reached, variables, inner, binding, slots, true),
            Condition::Exists(variables, inner) => self.quantifier(reached, variables, inner, binding, slots, false),
        }
    }

    fn compare(
        &mut self,
        comparator: Comparator,
        left: &Amount,
        right: &Amount,
        negated: bool,
        binding: &[Object],
    ) -> Ground {
        // Where something has no value, neither the comparison nor its negation holds.
        let Some(left) = self.ledger.expression(left, binding) else { return Ground::False };
        let Some(right) = self.ledger.expression(right, binding) else { return Ground::False };
        if let (Expression::Number(left), Expression::Number(right)) = (&left, &right) {
            return truth(comparator.compare(*left, *right) != negated);
        }
        let number = self.ledger.atom(comparator, left, right, self.count);
        self.count = self.count.max(number + 1);
        Ground::Literal(number << 1 | u32::from(negated))
    }

    fn junction(
        &mut self,
        reached: &Reached<'_>,
        parts: &[Condition],
        binding: &mut [Object],
        slots: &[usize],
        all: bool,
    ) -> Ground {
        let mut done = Vec::new();
        // What is quick to decide is decided first.
        let is_slow = |part: &Condition| !matches!(part, Condition::Literal(..) | Condition::Equal(..));
        for slow in [false, true] {
            for part in parts.iter().filter(|part| is_slow(part) == slow) {
                if !push(&mut done, self.ground(reached, part, binding, slots), all) {
                    return truth(!all);
                }
            }
        }
        joined(done, all)
    }

    fn quantifier(
        &mut self,
        reached: &Reached<'_>,
        variables: &[usize],
        inner: &Condition,
        binding: &mut [Object],
        slots: &[usize],
        all: bool,
    ) -> Ground {
        let Some((slot, rest)) = variables.split_first() else {
            return self.ground(reached, inner, binding, slots);
        };
        // A variable that is bound already was hoisted.
        if binding[*slot] != super::rule::OPEN {
            return self.quantifier(reached, rest, inner, binding, slots, all);
        }
        let mut done = Vec::new();
        for object in reached.kinds.list(slots[*slot]) {
            binding[*slot] = *object;
            let part = self.quantifier(reached, rest, inner, binding, slots, all);
            binding[*slot] = super::rule::OPEN;
            if !push(&mut done, part, all) {
                return truth(!all);
            }
        }
        joined(done, all)
    }

    /// Returns conjunctions, one of which must hold. Disjunctions that would make more than `most` become derived atoms.
    pub(super) fn alternatives(&mut self, ground: Ground, most: usize) -> Vec<Vec<Literal>> {
        let parts = match ground {
            Ground::False => return Vec::new(),
            Ground::And(parts) => parts,
            other => vec![other],
        };
        let (mut literals, mut disjunctions) = (Vec::new(), Vec::new());
        for part in parts {
            match part {
                Ground::Literal(literal) => literals.push(literal),
                Ground::Or(parts) => disjunctions.push(parts),
                _ => {}
            }
        }
        disjunctions.sort_by_key(Vec::len);
        let mut all = vec![literals];
        for parts in disjunctions {
            let choices: Vec<Vec<Literal>> =
                parts.into_iter().flat_map(|part| self.alternatives(part, SPLIT)).collect();
            if all.len() * choices.len() > most {
                let derived = self.disjunction(choices) << 1;
                all.iter_mut().for_each(|literals| literals.push(derived));
            } else {
                all = all.iter().flat_map(|one| choices.iter().map(|more| [one.as_slice(), more].concat())).collect();
            }
        }
        all.iter_mut().for_each(|literals| {
            literals.sort_unstable();
            literals.dedup();
        });
        all.retain(|literals| !literals.windows(2).any(|pair| pair[0] ^ 1 == pair[1]));
        all
    }

    /// As [`Self::alternatives`], few enough for actions.
    pub(super) fn split(&mut self, ground: Ground) -> Vec<Vec<Literal>> {
        self.alternatives(ground, SPLIT)
    }

    fn disjunction(&mut self, mut choices: Vec<Vec<Literal>>) -> u32 {
        choices.sort_unstable();
        choices.dedup();
        if let Some(atom) = self.disjunctions.get(&choices) {
            return *atom;
        }
        let head = self.count;
        self.count += 1;
        self.axioms.extend(choices.iter().map(|body| GroundAxiom { head, body: body.clone() }));
        self.disjunctions.insert(choices, head);
        head
    }
}

/// Adds a part; `false` where it decides the whole.
fn push(done: &mut Vec<Ground>, part: Ground, all: bool) -> bool {
    match part {
        Ground::True => return all,
        Ground::False => return !all,
        Ground::And(parts) if all => done.extend(parts),
        Ground::Or(parts) if !all => done.extend(parts),
        other => done.push(other),
    }
    true
}

fn joined(mut done: Vec<Ground>, all: bool) -> Ground {
    match done.len() {
        0 => truth(all),
        1 => done.remove(0),
        _ if all => Ground::And(done),
        _ => Ground::Or(done),
    }
}

fn truth(is_true: bool) -> Ground {
    if is_true { Ground::True } else { Ground::False }
}
