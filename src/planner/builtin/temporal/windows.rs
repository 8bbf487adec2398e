//! Facts that hold from a time on, or until a time: opening hours and deadlines (timed initial literals, Edelkamp and
//! Hoffmann 2004).
//!
//! Where no action changes such a fact, it says when the operators that need it may start.

use std::collections::{HashMap, HashSet};

use ferroplan::types::{Domain, Effect, Formula, Problem, Term, TimeSpec};

use super::compress::{changed, conjuncts, predicates};

/// Units of time in a second: plans are written in thousandths.
pub(super) const UNITS: f64 = 1000.0;

/// Moments that are closer to each other are one to the validator, in units.
pub(super) const SAME_MOMENT: f64 = 0.002;

/// From the first to the last moment.
pub(super) type Window = (u64, u64);

/// A window without moments.
const NEVER: Window = (1, 0);

/// A condition of an action that a timed fact may limit.
#[derive(Clone, Copy)]
pub(super) struct Limit<'a> {
    time: TimeSpec,
    name: &'a str,
    pub(super) terms: &'a [Term],
    /// Whether the fact has to hold, or must not.
    holds: bool,
}

/// What a fact is between two timed literals about it.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    /// The time of the first of them.
    since: f64,
    window: Window,
    holds: bool,
}

impl Stretch {
    /// Until the first literal.
    fn first(holds: bool) -> Self {
        Self { since: f64::NEG_INFINITY, window: (0, u64::MAX), holds }
    }
}

/// When timed facts hold.
#[derive(Debug, Default)]
pub(super) struct Windows<'a> {
    atoms: HashMap<(&'a str, Vec<&'a str>), Vec<Stretch>>,
    predicates: HashSet<&'a str>,
    /// The facts of these predicates that hold at first.
    init: HashSet<(&'a str, Vec<&'a str>)>,
}

impl<'a> Windows<'a> {
    /// The windows of a task; `None` where timed facts are more than conditions of actions, one by one ([`entangled`]).
    pub(super) fn new(domain: &'a Domain, problem: &'a Problem) -> Option<Self> {
        let mut windows = Self::default();
        let mut literals: Vec<_> = problem.til.iter().collect();
        // Of what is taken away and brought at once, it holds that it was brought.
        literals.sort_by(|one, other| one.time.total_cmp(&other.time).then(one.add.cmp(&other.add)));
        windows.predicates = literals.iter().map(|literal| literal.pred.as_str()).collect();
        let names = |list: &'a [String]| list.iter().map(String::as_str).collect::<Vec<_>>();
        let facts = problem.init_atoms.iter().filter(|(name, _)| windows.predicates.contains(name.as_str()));
        windows.init = facts.map(|(name, terms)| (name.as_str(), names(terms))).collect();
        for literal in literals {
            if !(0.0..1e12).contains(&literal.time) {
                return None;
            }
            let fact = (literal.pred.as_str(), names(&literal.args));
            let holds = windows.init.contains(&fact);
            let own = windows.atoms.entry(fact).or_insert_with(|| vec![Stretch::first(holds)]);
            let time = literal.time * UNITS;
            if own.last().is_some_and(|open| time - open.since <= SAME_MOMENT) {
                own.pop();
            }
            // At the moment of a literal nothing happens that is about its fact, also where it changes nothing.
            if let Some(open) = own.last_mut() {
                let last = ((time - SAME_MOMENT).ceil() as u64).checked_sub(1);
                open.window = last.map_or(NEVER, |last| (open.window.0, last));
            }
            let next = (time + SAME_MOMENT).floor() as u64 + 1;
            own.push(Stretch { since: time, window: (next, u64::MAX), holds: literal.add });
        }
        entangled(domain, problem).is_empty().then_some(windows)
    }

    /// The task in which timed facts do not matter where they have to be false, and what holds at any time holds from
    /// the start.
    pub(super) fn opened(&self, domain: Domain, problem: &Problem) -> (Domain, Problem) {
        let (mut domain, mut problem) = (domain, problem.clone());
        for action in &mut domain.actions {
            let is_kept =
                |part: &&Formula| !matches!(literal(part), Some((name, _, false)) if self.predicates.contains(name));
            action.precond = Formula::And(conjuncts(&action.precond).into_iter().filter(is_kept).cloned().collect());
        }
        for literal in std::mem::take(&mut problem.til) {
            let atom = (literal.pred, literal.args);
            if literal.add && !problem.init_atoms.contains(&atom) {
                problem.init_atoms.push(atom);
            }
        }
        (domain, problem)
    }

    /// The conditions of an action that timed facts may limit.
    pub(super) fn limits(&self, time: TimeSpec, condition: &'a Formula) -> Vec<Limit<'a>> {
        let literals = conjuncts(condition).into_iter().filter_map(literal);
        let literals = literals.filter(|(name, ..)| self.predicates.contains(name));
        literals.map(|(name, terms, holds)| Limit { time, name, terms, holds }).collect()
    }

    /// When an operator may start with the objects of a limit.
    pub(super) fn starts(&self, limit: Limit<'a>, objects: Vec<&'a str>, duration: u64) -> Vec<Window> {
        let fact = (limit.name, objects);
        let Some(stretches) = self.atoms.get(&fact) else {
            return if self.init.contains(&fact) == limit.holds { vec![(0, u64::MAX)] } else { Vec::new() };
        };
        let mut windows: Vec<Window> = Vec::new();
        let mut is_going_on = false;
        for stretch in stretches {
            match windows.last_mut() {
                // A literal that changes nothing does not disturb what goes on.
                Some(last) if is_going_on && stretch.holds == limit.holds && limit.time == TimeSpec::All => {
                    last.1 = stretch.window.1;
                }
                _ if stretch.holds == limit.holds => windows.push(stretch.window),
                _ => {}
            }
            is_going_on = stretch.holds == limit.holds;
        }
        let shift = |(from, to): Window| match limit.time {
            TimeSpec::Start => Some((from, to)),
            TimeSpec::End => Some((from.saturating_sub(duration), to.checked_sub(duration)?)),
            TimeSpec::All => Some((from, to.checked_sub(duration)?)),
        };
        windows.into_iter().filter_map(shift).filter(|(from, to)| from <= to).collect()
    }
}

/// The predicates of timed literals that are more than conditions of actions, one by one: actions change them, the goal asks
/// for them, or other conditions and effects depend on them.
pub(super) fn entangled<'a>(domain: &'a Domain, problem: &'a Problem) -> HashSet<&'a str> {
    let timed: HashSet<&str> = problem.til.iter().map(|literal| literal.pred.as_str()).collect();
    if timed.is_empty() {
        return timed;
    }
    let mut found: Vec<&str> = Vec::new();
    let durative = domain.durative_actions.iter();
    let conditions = durative.clone().flat_map(|action| action.conditions.iter().map(|(_, condition)| condition));
    for condition in conditions.chain(domain.actions.iter().map(|action| &action.precond)) {
        let others = conjuncts(condition).into_iter().filter(|part| literal(part).is_none());
        others.for_each(|part| predicates(part, &mut |name| found.push(name)));
    }
    let effects = durative.flat_map(|action| action.effects.iter().map(|(_, effect)| effect));
    for effect in effects.chain(domain.actions.iter().map(|action| &action.effect)) {
        found.extend(changed(effect));
        looked_at(effect, &mut |name| found.push(name));
    }
    predicates(&problem.goal, &mut |name| found.push(name));
    found.into_iter().filter(|name| timed.contains(name)).collect()
}

/// Calls `each` with every predicate of the conditions of an effect.
fn looked_at<'e>(effect: &'e Effect, each: &mut dyn FnMut(&'e str)) {
    match effect {
        Effect::When(condition, inner) => {
            predicates(condition, each);
            looked_at(inner, each);
        }
        Effect::Forall(_, inner) => looked_at(inner, each),
        Effect::And(inner) => inner.iter().for_each(|part| looked_at(part, each)),
        Effect::Add(..) | Effect::Del(..) | Effect::Num(..) => {}
    }
}

/// The atom of a literal, and whether it has to hold.
fn literal(formula: &Formula) -> Option<(&str, &[Term], bool)> {
    match formula {
        Formula::Atom(name, terms) => Some((name, terms, true)),
        Formula::Not(inner) => match &**inner {
            Formula::Atom(name, terms) => Some((name, terms, false)),
            _ => None,
        },
        _ => None,
    }
}

/// What lies in a window of both.
pub(super) fn intersected(one: &[Window], other: &[Window]) -> Vec<Window> {
    let both = |left: Window, right: Window| (left.0.max(right.0), left.1.min(right.1));
    let pairs = one.iter().flat_map(|left| other.iter().map(move |right| both(*left, *right)));
    pairs.filter(|(from, to)| from <= to).collect()
}
