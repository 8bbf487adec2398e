//! Conditions solved as joins: the facts there are give the variables their values, and only
//! variables that no positive fact mentions run through all objects of their type.

use std::cell::Cell;
use std::collections::HashMap;

use super::error::EvaluationError;
use super::goal::{Goal, Kind};
use super::index::{Candidates, Index};
use super::state::{Bindings, Ground, State, UNBOUND, choose_next};
use crate::pddl::model::{Arg, Fact, Formula};
use crate::pddl::types::TypeSet;

/// What to do with each solution; true ends the search.
type Visit<'v> = dyn FnMut(&mut Bindings) -> Result<bool, EvaluationError> + 'v;

/// The facts that came last: a solution is wanted only where the pivot is one of them.
pub(super) struct News<'n> {
    /// The number of the fact in the condition. Facts with lower numbers are older, so that a solution is found once.
    pub(super) pivot: usize,
    /// How many facts of a predicate are older.
    pub(super) older: &'n HashMap<u32, usize>,
}

/// Solves conditions over indexed facts.
pub(super) struct Join<'j, 'a> {
    state: &'j State<'a>,
    index: &'j Index,
    news: Option<News<'j>>,
    /// How many facts and objects may still be tried.
    budget: Cell<u64>,
}

impl<'j, 'a> Join<'j, 'a> {
    /// A join of all facts, or of the news with the others, that gives up after so many facts and objects were tried.
    pub(super) fn new(state: &'j State<'a>, index: &'j Index, news: Option<News<'j>>, budget: u64) -> Self {
        Self { state, index, news, budget: Cell::new(budget) }
    }

    /// Whether it gave up.
    pub(super) fn is_spent(&self) -> bool {
        self.budget.get() == 0
    }

    /// Values of the variables under which `formula` holds, those of `slots` among them.
    pub(super) fn first(
        &self,
        formula: &Formula,
        slots: &[u32],
        kinds: &[TypeSet],
        mut bindings: Bindings,
    ) -> Result<Option<Bindings>, EvaluationError> {
        let kinds: Vec<&TypeSet> = kinds.iter().collect();
        let mut found = None;
        self.solve(&Goal::new(formula, kinds.len()), &kinds, &mut bindings, &mut |bindings| {
            self.enumerate(slots, &kinds, bindings, &mut |bindings| {
                found = Some(bindings.clone());
                Ok(true)
            })
        })?;
        Ok(found)
    }

    fn spend(&self) -> Result<(), EvaluationError> {
        match self.budget.get().checked_sub(1) {
            Some(rest) if rest > 0 => {
                self.budget.set(rest);
                Ok(())
            }
            _ => {
                self.budget.set(0);
                Err(EvaluationError::Unchecked("too much was tried".to_owned()))
            }
        }
    }

    fn has_pivot(&self, goal: &Goal) -> bool {
        self.news.as_ref().is_some_and(|news| goal.facts.contains(&news.pivot))
    }

    /// Visits values of the variables under which `goal` holds; some may stay unbound.
    pub(super) fn solve(
        &self,
        goal: &Goal,
        kinds: &[&TypeSet],
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<bool, EvaluationError> {
        match &goal.kind {
            Kind::Fact(fact) => self.solve_fact(goal.facts.start, fact, kinds, bindings, visit),
            Kind::Same(left, right) => self.solve_same(*left, *right, kinds, bindings, visit),
            Kind::All(parts) => self.solve_all(&parts.iter().collect::<Vec<_>>(), kinds, bindings, visit),
            Kind::Any(_) | Kind::Exists(..) if is_closed(goal, bindings) => {
                // One way in which it holds is enough.
                let holds = self.solve_open(goal, kinds, bindings, &mut |_| Ok(true))?;
                if holds { visit(bindings) } else { Ok(false) }
            }
            Kind::Any(_) | Kind::Exists(..) => self.solve_open(goal, kinds, bindings, visit),
            Kind::Test(formula) => self.enumerate(&goal.free, kinds, bindings, &mut |bindings| {
                if self.state.is_true(formula, bindings)? { visit(bindings) } else { Ok(false) }
            }),
        }
    }

    fn solve_open(
        &self,
        goal: &Goal,
        kinds: &[&TypeSet],
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<bool, EvaluationError> {
        match &goal.kind {
            Kind::Any(parts) => {
                for part in parts.iter().filter(|part| !self.has_pivot(goal) || self.has_pivot(part)) {
                    if self.solve(part, kinds, bindings, visit)? {
                        return Ok(true);
                    }
                }
                Ok(false)
            }
            Kind::Exists(quantifier, inner) => {
                // A variable that no condition mentions wants an object, too.
                if quantifier.variables.iter().any(|variable| self.state.members(&variable.kind).is_empty()) {
                    return Ok(false);
                }
                let first = quantifier.first as usize;
                let end = first + quantifier.variables.len();
                let mut inner_kinds = kinds.get(..first).unwrap_or(kinds).to_vec();
                inner_kinds.extend(quantifier.variables.iter().map(|variable| &variable.kind));
                bindings.resize(end.max(bindings.len()), UNBOUND);
                let outer = bindings[first..end].to_vec();
                bindings[first..end].fill(UNBOUND);
                let result = self.solve(inner, &inner_kinds, bindings, visit);
                bindings[first..end].copy_from_slice(&outer);
                result
            }
            _ => self.solve(goal, kinds, bindings, visit),
        }
    }

    fn solve_all(
        &self,
        parts: &[&Goal],
        kinds: &[&TypeSet],
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<bool, EvaluationError> {
        let next = parts.iter().enumerate().min_by_key(|(_, part)| self.rank(part, bindings));
        let Some((place, first)) = next else { return visit(bindings) };
        let (before, after) = (parts.get(..place).unwrap_or_default(), parts.get(place + 1..).unwrap_or_default());
        if before.is_empty() && after.is_empty() {
            return self.solve(first, kinds, bindings, visit);
        }
        let rest = [before, after].concat();
        self.solve(first, kinds, bindings, &mut |bindings| self.solve_all(&rest, kinds, bindings, visit))
    }

    /// What comes first in a conjunction: the news, then what only has to be looked up, then what binds variables in the fewest
    /// ways. What may be wrong of values that other parts exclude comes last, and so does what runs through all objects.
    fn rank(&self, goal: &Goal, bindings: &Bindings) -> (u8, usize) {
        if self.has_pivot(goal) {
            return (0, 0);
        }
        let is_closed = is_closed(goal, bindings);
        match &goal.kind {
            Kind::Fact(_) | Kind::Same(..) if is_closed => (1, 0),
            Kind::Test(formula) if is_closed && is_plain(formula) => (2, 0),
            Kind::Same(left, right) if [left, right].into_iter().any(|side| is_known(side, bindings)) => (3, 0),
            Kind::Any(_) | Kind::Exists(..) if is_closed => (4, 0),
            Kind::Fact(fact) => (5, self.candidates(goal.facts.start, fact, bindings).len()),
            Kind::All(_) | Kind::Exists(..) => (6, 0),
            Kind::Any(_) => (7, 0),
            Kind::Test(_) | Kind::Same(..) => (8, 0),
        }
    }

    /// The facts that may be the one with this number.
    fn candidates(&self, number: usize, fact: &Fact, bindings: &Bindings) -> Candidates<'_> {
        let mut range = 0..self.index.count(fact.predicate);
        if let Some(news) = &self.news
            && let Some(older) = news.older.get(&fact.predicate)
        {
            match number.cmp(&news.pivot) {
                std::cmp::Ordering::Less => range.end = *older,
                std::cmp::Ordering::Equal => range.start = *older,
                std::cmp::Ordering::Greater => {}
            }
        }
        self.index.candidates(fact, range, bindings)
    }

    fn solve_fact(
        &self,
        number: usize,
        fact: &Fact,
        kinds: &[&TypeSet],
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<bool, EvaluationError> {
        let is_pivot = self.news.as_ref().is_some_and(|news| news.pivot == number);
        let mut open: Vec<usize> = Vec::new();
        for argument in &fact.arguments {
            match argument {
                Arg::Slot(slot) if !is_bound(*slot, bindings) => open.push(*slot as usize),
                Arg::Slot(_) | Arg::Object(_) => {}
                Arg::Fluent => return Err(EvaluationError::Unchecked("object fluents are not simulated".to_owned())),
            }
        }
        if open.is_empty() && !is_pivot {
            let ground = self.state.ground(fact.predicate, &fact.arguments, bindings)?;
            return if self.state.holds(&ground)? { visit(bindings) } else { Ok(false) };
        }
        for candidate in self.candidates(number, fact, bindings).iter() {
            self.spend()?;
            let stopped = self.unify(fact, candidate, kinds, bindings) && visit(bindings)?;
            for slot in &open {
                if let Some(value) = bindings.get_mut(*slot) {
                    *value = UNBOUND;
                }
            }
            if stopped {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn unify(&self, fact: &Fact, candidate: &Ground, kinds: &[&TypeSet], bindings: &mut Bindings) -> bool {
        fact.arguments.iter().zip(candidate.iter().skip(1)).all(|(argument, object)| match argument {
            Arg::Object(number) => number == object,
            Arg::Fluent => false,
            Arg::Slot(slot) => self.bind(*slot, *object, kinds, bindings),
        })
    }

    /// Whether a variable has this value, or can have it and has it now.
    fn bind(&self, slot: u32, object: u32, kinds: &[&TypeSet], bindings: &mut Bindings) -> bool {
        match (bindings.get_mut(slot as usize), kinds.get(slot as usize)) {
            (Some(value), Some(kind)) if *value == UNBOUND => {
                *value = object;
                self.state.is_member(object, kind)
            }
            (Some(value), _) => *value == object,
            (None, _) => false,
        }
    }

    fn solve_same(
        &self,
        left: Arg,
        right: Arg,
        kinds: &[&TypeSet],
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<bool, EvaluationError> {
        match (known(left, bindings), known(right, bindings)) {
            (Some(left), Some(right)) => {
                if left == right {
                    visit(bindings)
                } else {
                    Ok(false)
                }
            }
            (Some(object), None) | (None, Some(object)) => {
                let other = if known(left, bindings).is_none() { left } else { right };
                let Arg::Slot(slot) = other else { return Ok(false) };
                self.spend()?;
                let stopped = self.bind(slot, object, kinds, bindings) && visit(bindings)?;
                if let Some(value) = bindings.get_mut(slot as usize) {
                    *value = UNBOUND;
                }
                Ok(stopped)
            }
            (None, None) => {
                let Arg::Slot(slot) = left else { return Ok(false) };
                self.enumerate(&[slot], kinds, bindings, &mut |bindings| match is_known(&left, bindings) {
                    true => self.solve_same(left, right, kinds, bindings, visit),
                    false => Ok(false),
                })
            }
        }
    }

    /// Visits every choice of values for those of `slots` that have none.
    pub(super) fn enumerate(
        &self,
        slots: &[u32],
        kinds: &[&TypeSet],
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<bool, EvaluationError> {
        let open: Vec<usize> = slots
            .iter()
            .map(|slot| *slot as usize)
            .filter(|slot| bindings.get(*slot).is_some_and(|value| *value == UNBOUND))
            .collect();
        if open.is_empty() {
            self.spend()?;
            return visit(bindings);
        }
        let members: Vec<_> =
            open.iter().filter_map(|slot| kinds.get(*slot)).map(|kind| self.state.members(kind)).collect();
        if members.len() != open.len() || members.iter().any(|members| members.is_empty()) {
            return Ok(false);
        }
        let mut chosen = vec![0_usize; open.len()];
        let stopped = loop {
            for ((slot, members), choice) in open.iter().zip(&members).zip(&chosen) {
                bindings[*slot] = members[*choice];
            }
            self.spend()?;
            if visit(bindings)? {
                break true;
            }
            if !choose_next(&mut chosen, &members) {
                break false;
            }
        };
        for slot in open {
            bindings[slot] = UNBOUND;
        }
        Ok(stopped)
    }
}

/// Whether all variables from outside have values.
fn is_closed(goal: &Goal, bindings: &Bindings) -> bool {
    goal.free.iter().all(|slot| is_bound(*slot, bindings))
}

fn is_bound(slot: u32, bindings: &Bindings) -> bool {
    bindings.get(slot as usize).is_some_and(|value| *value != UNBOUND)
}

fn known(argument: Arg, bindings: &Bindings) -> Option<u32> {
    match argument {
        Arg::Object(number) => Some(number),
        Arg::Slot(slot) => bindings.get(slot as usize).copied().filter(|value| *value != UNBOUND),
        Arg::Fluent => None,
    }
}

fn is_known(argument: &Arg, bindings: &Bindings) -> bool {
    known(*argument, bindings).is_some()
}

/// Whether a condition is looked up at once, and never wrong.
fn is_plain(formula: &Formula) -> bool {
    match formula {
        Formula::Not(inner) => is_plain(inner),
        Formula::Fact(fact) => !fact.arguments.contains(&Arg::Fluent),
        Formula::Same(left, right) => *left != Arg::Fluent && *right != Arg::Fluent,
        Formula::And(parts) | Formula::Or(parts) => parts.iter().all(is_plain),
        Formula::Imply(left, right) => is_plain(left) && is_plain(right),
        _ => false,
    }
}
