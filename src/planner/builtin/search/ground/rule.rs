//! Rules over relations, and the joins that find their instances.
//!
//! The atoms of a body are matched one by one, next always the one with the fewest tuples left: static predicates,
//! which have few, come first by themselves (Helmert 2009, "Concise finite-domain representations for PDDL planning tasks",
//! orders joins with the same aim).

use super::super::lifted::{Atom, Condition, Object, Term};
use super::relation::{Key, Relations};

/// No object yet.
pub(super) const OPEN: Object = Object::MAX;

/// What must hold besides the atoms of the body.
#[derive(Debug, Clone)]
pub(super) enum Filter {
    /// The terms are equal, or not equal (`true`).
    Equal(Term, Term, bool),
    /// No tuple of a predicate that never changes.
    Absent(Atom),
}

/// Bodies of atoms that lead to a head.
#[derive(Debug, Clone)]
pub(super) struct Rule {
    /// The type of each slot.
    pub(super) slots: Vec<usize>,
    /// The slots that must be bound.
    pub(super) wanted: Vec<usize>,
    pub(super) body: Vec<Atom>,
    pub(super) filters: Vec<Filter>,
    pub(super) head: Atom,
}

/// Which objects belong to a type.
#[derive(Debug)]
pub(super) struct Kinds {
    lists: Vec<Vec<Object>>,
    members: Vec<Vec<bool>>,
}

impl Kinds {
    pub(super) fn new(types: &[Vec<Object>], objects: usize) -> Self {
        let mut members = vec![vec![false; objects]; types.len()];
        for (member, list) in members.iter_mut().zip(types) {
            list.iter().for_each(|object| member[*object as usize] = true);
        }
        Self { lists: types.to_vec(), members }
    }

    pub(super) fn list(&self, kind: usize) -> &[Object] {
        &self.lists[kind]
    }

    fn has(&self, kind: usize, object: Object) -> bool {
        self.members[kind][object as usize]
    }
}

/// Splits a condition into the atoms and filters of a body; the rest of it is left to the instances.
pub(super) fn split(condition: &Condition, is_static: &dyn Fn(usize) -> bool) -> (Vec<Atom>, Vec<Filter>) {
    let (mut body, mut filters) = (Vec::new(), Vec::new());
    for part in condition.conjuncts() {
        match part {
            // More than the bits of a mask are not needed to find the instances.
            Condition::Literal(atom, false) if body.len() < 60 => body.push(atom.clone()),
            Condition::Literal(atom, true) if is_static(atom.predicate) => filters.push(Filter::Absent(atom.clone())),
            Condition::Equal(left, right, negated) => filters.push(Filter::Equal(*left, *right, *negated)),
            _ => {}
        }
    }
    (body, filters)
}

/// A search for the bindings of a rule.
pub(super) struct Join<'a> {
    pub(super) relations: &'a mut Relations,
    pub(super) kinds: &'a Kinds,
    pub(super) rule: &'a Rule,
    /// The atom that starts the search, and its tuple: equal atoms before it must match others.
    pub(super) start: Option<(usize, u32)>,
    pub(super) binding: Vec<Object>,
    pub(super) ids: Vec<u32>,
    /// After how many more bindings the search ends.
    pub(super) left: usize,
}

impl Join<'_> {
    /// Binds the slots of an atom to a tuple; says which were open, or that the tuple does not fit.
    fn bind(&mut self, atom: &Atom, id: u32) -> Result<u64, u64> {
        let tuple = self.relations.get(atom.predicate).tuple(id);
        let mut bound = 0;
        for (term, object) in atom.terms.iter().zip(tuple) {
            match *term {
                Term::Object(known) if known != *object => return Err(bound),
                Term::Object(_) => {}
                Term::Slot(slot) if self.binding[slot] == OPEN => {
                    if !self.kinds.has(self.rule.slots[slot], *object) {
                        return Err(bound);
                    }
                    self.binding[slot] = *object;
                    bound |= 1 << slot;
                }
                Term::Slot(slot) if self.binding[slot] != *object => return Err(bound),
                Term::Slot(_) => {}
            }
        }
        Ok(bound)
    }

    fn free(&mut self, mut bound: u64) {
        while bound != 0 {
            self.binding[bound.trailing_zeros() as usize] = OPEN;
            bound &= bound - 1;
        }
    }

    fn value(&self, term: Term) -> Option<Object> {
        match term {
            Term::Object(object) => Some(object),
            Term::Slot(slot) => Some(self.binding[slot]).filter(|object| *object != OPEN),
        }
    }

    /// Whether no filter rules out what is bound.
    fn passes(&self) -> bool {
        self.rule.filters.iter().all(|filter| match filter {
            Filter::Equal(left, right, negated) => match (self.value(*left), self.value(*right)) {
                (Some(left), Some(right)) => (left == right) != *negated,
                _ => true,
            },
            Filter::Absent(atom) => {
                let open = atom.terms.iter().any(|term| self.value(*term).is_none());
                open || self
                    .relations
                    .find(atom.predicate, atom.terms.iter().filter_map(|term| self.value(*term)))
                    .is_none()
            }
        })
    }

    /// Finds all bindings, starting from the tuple of an atom.
    pub(super) fn from(&mut self, atom: usize, id: u32, found: &mut dyn FnMut(&[Object])) {
        self.start = Some((atom, id));
        let rule = self.rule;
        match self.bind(&rule.body[atom], id) {
            Ok(bound) => {
                self.extend(1 << atom, found);
                self.free(bound);
            }
            Err(bound) => self.free(bound),
        }
    }

    /// Matches the atoms that are not done.
    pub(super) fn extend(&mut self, done: u64, found: &mut dyn FnMut(&[Object])) {
        if self.left == 0 || !self.passes() {
            return;
        }
        let rule = self.rule;
        let mut best: Option<(usize, usize, u32, Key)> = None;
        for (place, atom) in rule.body.iter().enumerate().filter(|(place, _)| done >> place & 1 == 0) {
            let (mut mask, mut key_of) = (0, Vec::with_capacity(atom.terms.len()));
            for (position, term) in atom.terms.iter().enumerate() {
                if let Some(object) = self.value(*term) {
                    mask |= 1 << position;
                    key_of.push(object);
                }
            }
            let key = self.relations.key(key_of.into_iter());
            let count = self.relations.count(atom.predicate, mask, key);
            if count == 0 {
                return;
            }
            if best.is_none_or(|(least, ..)| count < least) {
                best = Some((count, place, mask, key));
            }
        }
        let Some((_, place, mask, key)) = best else {
            return self.fill(0, found);
        };
        let atom = &rule.body[place];
        let base = self.ids.len();
        self.relations.select(atom.predicate, mask, key, &mut self.ids);
        for position in base..self.ids.len() {
            let id = self.ids[position];
            let is_met = self
                .start
                .is_some_and(|(start, met)| place < start && met == id && rule.body[start].predicate == atom.predicate);
            if is_met {
                continue;
            }
            match self.bind(atom, id) {
                Ok(bound) => {
                    self.extend(done | 1 << place, found);
                    self.free(bound);
                }
                Err(bound) => self.free(bound),
            }
        }
        self.ids.truncate(base);
    }

    /// Binds the slots that no atom mentions to every object of their types.
    fn fill(&mut self, next: usize, found: &mut dyn FnMut(&[Object])) {
        let rule = self.rule;
        let Some(open) = (next..rule.wanted.len()).find(|place| self.binding[rule.wanted[*place]] == OPEN) else {
            found(&self.binding);
            self.left = self.left.saturating_sub(1);
            return;
        };
        let (slot, kinds) = (rule.wanted[open], self.kinds);
        for object in kinds.list(rule.slots[slot]) {
            self.binding[slot] = *object;
            if self.left == 0 {
                break;
            }
            if self.passes() {
                self.fill(open + 1, found);
            }
        }
        self.binding[slot] = OPEN;
    }
}
