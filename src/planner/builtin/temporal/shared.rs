//! Numbers that actions share: all that actions do to them is to add and to take what no action changes, and all that they ask
//! of them is asked at a start. Then a schedule may let these actions overlap ([`reservoir`]).
//!
//! [`reservoir`]: crate::planner::builtin::search::reservoir

use std::collections::HashSet;

use ferroplan::types::{AssignOp, CompOp, Domain, Effect, Expr, Formula, Term, TimeSpec};

use super::compress::{conjuncts, parts};
use crate::planner::builtin::compared::{of_expression, of_formula};
use crate::planner::builtin::search::reservoir::{Comparison, Draw};

/// What a part of an action asks of a shared number, or does to it.
#[derive(Clone, Copy)]
pub(super) struct Sharing<'a> {
    pub(super) name: &'a str,
    pub(super) terms: &'a [Term],
    /// What it is compared with, or what is added.
    pub(super) amount: &'a Expr,
    kind: Kind,
}

#[derive(Clone, Copy)]
enum Kind {
    Test(Comparison),
    /// Whether it is added at the end, and whether it is taken.
    Shift {
        is_end: bool,
        is_taken: bool,
    },
}

impl Sharing<'_> {
    /// Adds it, with the value of its amount, to all that an operator does to the number.
    pub(super) fn add(&self, value: f64, draw: &mut Draw) {
        match self.kind {
            Kind::Test(comparison) => draw.tests.push((comparison, value)),
            Kind::Shift { is_end, is_taken } => {
                let place = if is_end { &mut draw.at_end } else { &mut draw.at_start };
                *place += if is_taken { -value } else { value };
            }
        }
    }
}

/// Each action with its conditions and its effects, by moments.
type Parts<'a> = (&'a str, Vec<(TimeSpec, &'a Formula)>, Vec<(TimeSpec, &'a Effect)>);

fn actions(domain: &Domain) -> impl Iterator<Item = Parts<'_>> {
    let durative = domain.durative_actions.iter().map(|action| {
        let conditions = action
            .conditions
            .iter()
            .flat_map(|(time, whole)| conjuncts(whole).into_iter().map(move |condition| (*time, condition)));
        let effects =
            action.effects.iter().flat_map(|(time, whole)| parts(whole).into_iter().map(move |effect| (*time, effect)));
        (action.name.as_str(), conditions.collect(), effects.collect())
    });
    let others = domain.actions.iter().map(|action| {
        let conditions = conjuncts(&action.precond).into_iter().map(|condition| (TimeSpec::Start, condition));
        let effects = parts(&action.effect).into_iter().map(|effect| (TimeSpec::Start, effect));
        (action.name.as_str(), conditions.collect(), effects.collect())
    });
    durative.chain(others)
}

/// The functions that actions may share, of those that they change.
pub(super) fn functions<'a>(domain: &'a Domain, changed: &HashSet<&'a str>) -> HashSet<&'a str> {
    let mut others: HashSet<String> = HashSet::new();
    let mut found: HashSet<&str> = HashSet::new();
    for (_, conditions, effects) in actions(domain) {
        for (time, condition) in conditions {
            match test(condition, changed).filter(|_| time == TimeSpec::Start) {
                Some(_) => {}
                None => of_formula(condition, &mut others),
            }
        }
        for (time, effect) in effects {
            match shift(time, effect, changed) {
                Some(shift) => drop(found.insert(shift.name)),
                None => of_effect(effect, &mut others),
            }
        }
    }
    found.retain(|name| !others.contains(*name));
    found
}

/// What each action asks of shared functions and does to them.
pub(super) fn of_actions<'a>(
    domain: &'a Domain,
    shared: &HashSet<&'a str>,
) -> impl Iterator<Item = (&'a str, Vec<Sharing<'a>>)> {
    actions(domain).map(|(name, conditions, effects)| {
        let tests = conditions.into_iter().filter_map(|(_, condition)| test(condition, shared));
        let shifts = effects.into_iter().filter_map(|(time, effect)| shift(time, effect, shared));
        (name, tests.chain(shifts).filter(|sharing| shared.contains(sharing.name)).collect())
    })
}

/// A comparison of one number that changes with what does not.
fn test<'a>(formula: &'a Formula, changed: &HashSet<&str>) -> Option<Sharing<'a>> {
    let Formula::Comp(operator, left, right) = formula else { return None };
    let (left_comparison, right_comparison) = match operator {
        CompOp::Lt => (Comparison::Less, Comparison::More),
        CompOp::Le => (Comparison::AtMost, Comparison::AtLeast),
        CompOp::Eq => (Comparison::Equal, Comparison::Equal),
        CompOp::Ge => (Comparison::AtLeast, Comparison::AtMost),
        CompOp::Gt => (Comparison::More, Comparison::Less),
    };
    let of = |number: &'a Expr, amount: &'a Expr, comparison| match number {
        Expr::Fluent(name, terms) if changed.contains(name.as_str()) && !depends(amount, changed) => {
            Some(Sharing { name, terms, amount, kind: Kind::Test(comparison) })
        }
        _ => None,
    };
    of(left, right, left_comparison).or_else(|| of(right, left, right_comparison))
}

/// An effect that adds to a number or takes from it what does not change.
fn shift<'a>(time: TimeSpec, effect: &'a Effect, changed: &HashSet<&str>) -> Option<Sharing<'a>> {
    match effect {
        Effect::Num(operator @ (AssignOp::Increase | AssignOp::Decrease), name, terms, amount)
            if !depends(amount, changed) =>
        {
            let (is_end, is_taken) = (time == TimeSpec::End, *operator == AssignOp::Decrease);
            Some(Sharing { name, terms, amount, kind: Kind::Shift { is_end, is_taken } })
        }
        _ => None,
    }
}

fn depends(expression: &Expr, changed: &HashSet<&str>) -> bool {
    let mut read = HashSet::new();
    of_expression(expression, &mut read);
    read.iter().any(|name| changed.contains(name.as_str()))
}

/// Adds the functions that an effect changes, and those that it reads.
fn of_effect(effect: &Effect, found: &mut HashSet<String>) {
    match effect {
        Effect::Num(_, name, _, amount) => {
            found.insert(name.clone());
            of_expression(amount, found);
        }
        Effect::When(condition, inner) => {
            of_formula(condition, found);
            of_effect(inner, found);
        }
        Effect::Forall(_, inner) => of_effect(inner, found),
        Effect::And(inner) => inner.iter().for_each(|part| of_effect(part, found)),
        Effect::Add(..) | Effect::Del(..) => {}
    }
}
