//! Facts that hold from a time on, or until a time: opening hours and deadlines (timed initial literals, Edelkamp and
//! Hoffmann 2004).
//!
//! Where no action changes such a fact, it says when the operators that need it may start.

use std::collections::HashMap;

use ferroplan::types::{Domain, Effect, Formula, Problem, Term, TimeSpec};

use super::compress::{changed, conjuncts, looks, predicates};

/// Units of time in a second: plans are written in thousandths.
pub(super) const UNITS: f64 = 1000.0;

/// From the first to the last moment.
pub(super) type Window = (u64, u64);

/// When timed facts hold.
#[derive(Debug, Default)]
pub(super) struct Windows<'a> {
    atoms: HashMap<(&'a str, Vec<&'a str>), Vec<Window>>,
    predicates: Vec<&'a str>,
}

impl<'a> Windows<'a> {
    /// The windows of a task; `None` where timed facts are more than conditions of actions, one by one.
    pub(super) fn new(domain: &'a Domain, problem: &'a Problem) -> Option<Self> {
        let mut windows = Self::default();
        let mut literals: Vec<_> = problem.til.iter().collect();
        // Of what is taken away and brought at once, it holds that it was brought.
        literals.sort_by(|one, other| one.time.total_cmp(&other.time).then(one.add.cmp(&other.add)));
        for literal in literals {
            if !(0.0..1e12).contains(&literal.time) {
                return None;
            }
            windows.predicates.push(&literal.pred);
            let arguments: Vec<&str> = literal.args.iter().map(String::as_str).collect();
            let at_first = || {
                let is_so =
                    problem.init_atoms.iter().any(|(name, terms)| *name == literal.pred && *terms == literal.args);
                if is_so { vec![(0, u64::MAX)] } else { Vec::new() }
            };
            let own = windows.atoms.entry((&literal.pred, arguments)).or_insert_with(at_first);
            let time = literal.time * UNITS;
            let open = own.last_mut().filter(|(_, to)| *to == u64::MAX);
            match (literal.add, open) {
                (true, None) => own.push((time.floor() as u64 + 1, u64::MAX)),
                // Nothing happens at the moment of the change.
                (false, Some((_, to))) => *to = (time.ceil() as u64).saturating_sub(1),
                // What changes nothing happens all the same, and at its moment nothing else may.
                (true, Some(_)) | (false, None) => return None,
            }
        }
        windows.are_conditions(domain, problem).then_some(windows)
    }

    fn are_conditions(&self, domain: &Domain, problem: &Problem) -> bool {
        if self.predicates.is_empty() {
            return true;
        }
        let durative = domain.durative_actions.iter();
        let conditions = durative.clone().flat_map(|action| action.conditions.iter().map(|(_, condition)| condition));
        let mut conditions = conditions.chain(domain.actions.iter().map(|action| &action.precond));
        let effects = durative.flat_map(|action| action.effects.iter().map(|(_, effect)| effect));
        let mut effects = effects.chain(domain.actions.iter().map(|action| &action.effect));
        conditions.all(|condition| {
            conjuncts(condition).into_iter().all(|part| matches!(part, Formula::Atom(..)) || !self.is_in(part))
        }) && !effects.any(|effect| self.is_touched(effect))
            && !self.is_in(&problem.goal)
    }

    fn is_in(&self, formula: &Formula) -> bool {
        let mut is_in = false;
        predicates(formula, &mut |name| is_in |= self.predicates.contains(&name));
        is_in
    }

    /// Whether an effect changes a timed fact, or depends on one.
    fn is_touched(&self, effect: &Effect) -> bool {
        changed(effect).iter().any(|name| self.predicates.contains(name))
            || looks(effect, &|condition| self.is_in(condition))
    }

    /// The problem in which what holds at any time holds from the start.
    pub(super) fn opened(&self, problem: &Problem) -> Problem {
        let mut problem = problem.clone();
        for literal in std::mem::take(&mut problem.til) {
            let atom = (literal.pred, literal.args);
            if literal.add && !problem.init_atoms.contains(&atom) {
                problem.init_atoms.push(atom);
            }
        }
        problem
    }

    /// The conditions of an action that timed facts may limit.
    pub(super) fn limits(&self, time: TimeSpec, condition: &'a Formula) -> Vec<(TimeSpec, &'a str, &'a [Term])> {
        let atom = |part: &'a Formula| match part {
            Formula::Atom(name, terms) => Some((time, name.as_str(), terms.as_slice())),
            _ => None,
        };
        let atoms = conjuncts(condition).into_iter().filter_map(atom);
        atoms.filter(|(_, name, _)| self.predicates.contains(name)).collect()
    }

    /// When an operator may start whose condition is a fact; `None` where the fact is not timed.
    pub(super) fn starts(&self, time: TimeSpec, fact: &(&'a str, Vec<&'a str>), duration: u64) -> Option<Vec<Window>> {
        let shift = |(from, to): Window| match time {
            TimeSpec::Start => Some((from, to)),
            TimeSpec::End => Some((from.saturating_sub(duration), to.checked_sub(duration)?)),
            TimeSpec::All => Some((from, to.checked_sub(duration)?)),
        };
        Some(self.atoms.get(fact)?.iter().filter_map(|window| shift(*window)).filter(|(from, to)| from <= to).collect())
    }
}

/// What lies in a window of both.
pub(super) fn intersected(one: &[Window], other: &[Window]) -> Vec<Window> {
    let both = |left: Window, right: Window| (left.0.max(right.0), left.1.min(right.1));
    let pairs = one.iter().flat_map(|left| other.iter().map(move |right| both(*left, *right)));
    pairs.filter(|(from, to)| from <= to).collect()
}
