//! Durative actions as actions that happen at once (compressed: Coles, Fox, Long and Smith 2009).
//!
//! The action needs what the durative one needs at any time and does not bring about itself, and leaves what that one
//! leaves. Parameters that may be one object are told apart: what an action takes away at its start it cannot need
//! later, and what it brings at its start and takes away at its end does not stay.

use std::collections::HashSet;

use ferroplan::types::{Action, AssignOp, Domain, DurativeAction, Effect, Expr, Formula, Term, TimeSpec};

use crate::planner::builtin::compared::{of_expression, of_formula};

/// The domain without durations; `None` where an action is none of these.
pub(super) fn compressed(domain: &Domain) -> Option<Domain> {
    let mut domain = domain.clone();
    let actions: Option<Vec<Action>> = domain.durative_actions.drain(..).map(|action| compress(&action)).collect();
    domain.actions.extend(actions?);
    Some(domain)
}

fn compress(action: &DurativeAction) -> Option<Action> {
    let at =
        |time: TimeSpec| action.effects.iter().filter(move |(at, _)| *at == time).flat_map(|(_, effect)| parts(effect));
    let starting: Vec<&Effect> = at(TimeSpec::Start).collect();
    let ending: Vec<&Effect> = at(TimeSpec::End).collect();
    let mut conditions = Vec::new();
    for (time, formula) in &action.conditions {
        for part in conjuncts(formula) {
            match *time {
                // Between a start and an end at one moment nothing has to hold.
                TimeSpec::All if is_momentary(action) => {}
                TimeSpec::Start => conditions.push(part.clone()),
                _ => conditions.push(before(part, &starting)?),
            }
        }
    }
    let mut effects = Vec::new();
    for effect in &starting {
        effects.extend(stays(effect, &ending)?);
    }
    for effect in &ending {
        let is_changed = |formula: &Formula| starting.iter().any(|start| changes_any(start, formula));
        if looks(effect, &is_changed) || reads_any(effect, &starting) {
            return None;
        }
        effects.push((*effect).clone());
    }
    Some(Action {
        name: action.name.clone(),
        params: action.params.clone(),
        precond: Formula::And(conditions),
        effect: Effect::And(effects),
        monitored: false,
    })
}

/// Whether an action never takes any time.
pub(super) fn is_momentary(action: &DurativeAction) -> bool {
    matches!(action.duration.max, Some(Expr::Num(most)) if most == 0.0)
}

/// What has to hold beforehand for a condition to hold after the start; `None` where that is not seen here.
fn before(formula: &Formula, starting: &[&Effect]) -> Option<Formula> {
    if !starting.iter().any(|effect| changes_any(effect, formula)) {
        return Some(formula.clone());
    }
    let all = |parts: &[Formula]| parts.iter().map(|part| before(part, starting)).collect::<Option<Vec<_>>>();
    Some(match formula {
        Formula::Atom(name, terms) => {
            let (mut brought, mut kept) = (Vec::new(), vec![formula.clone()]);
            for effect in starting.iter().filter(|effect| changes_any(effect, formula)) {
                let effect = Literal::made(effect)?;
                let Some(equalities) = (effect.name == name).then(|| unify(effect.terms, terms)).flatten() else {
                    continue;
                };
                match (effect.holds, equalities.is_empty()) {
                    // Of what is taken away and brought at once, it holds that it was brought.
                    (true, true) => return Some(Formula::True),
                    (true, false) => brought.push(Formula::And(equalities)),
                    (false, true) => kept = vec![Formula::False],
                    (false, false) => kept.push(Formula::Not(Box::new(Formula::And(equalities)))),
                }
            }
            match brought.is_empty() {
                true => Formula::And(kept),
                false => Formula::Or(brought.into_iter().chain([Formula::And(kept)]).collect()),
            }
        }
        Formula::Not(inner) => Formula::Not(Box::new(before(inner, starting)?)),
        Formula::And(parts) => Formula::And(all(parts)?),
        Formula::Or(parts) => Formula::Or(all(parts)?),
        Formula::Forall(variables, inner) | Formula::Exists(variables, inner) => {
            // A parameter that is named like one of these variables would be taken for it.
            let is_taken =
                |term: &Term| matches!(term, Term::Var(name) if variables.iter().any(|(own, _)| own == name));
            if starting.iter().any(|effect| Literal::made(effect).is_none_or(|made| made.terms.iter().any(is_taken))) {
                return None;
            }
            let inner = Box::new(before(inner, starting)?);
            match formula {
                Formula::Forall(..) => Formula::Forall(variables.clone(), inner),
                _ => Formula::Exists(variables.clone(), inner),
            }
        }
        _ => return None,
    })
}

/// What is left of an effect at the start when the action has ended.
fn stays(effect: &Effect, ending: &[&Effect]) -> Option<Option<Effect>> {
    let Some(made) = Literal::made(effect) else {
        // Which atoms it is about is not seen here. What is added to a value and what is taken from it have no order.
        let is_touched = |end: &&&Effect| changed(end).iter().any(|name| changed(effect).contains(name));
        let mut touched = ending.iter().filter(is_touched);
        return touched.all(|end| is_sum(effect) && is_sum(end)).then(|| Some(effect.clone()));
    };
    if !made.holds {
        return Some(Some(effect.clone()));
    }
    let mut apart = Vec::new();
    for end in ending {
        match Literal::made(end) {
            Some(end) if end.name == made.name && !end.holds => match unify(end.terms, made.terms) {
                None => {}
                Some(equalities) if equalities.is_empty() => return Some(None),
                Some(equalities) => apart.push(Formula::Not(Box::new(Formula::And(equalities)))),
            },
            Some(_) => {}
            None if changed(end).contains(&made.name) => return None,
            None => {}
        }
    }
    Some(Some(match apart.is_empty() {
        true => effect.clone(),
        false => Effect::When(Formula::And(apart), Box::new(effect.clone())),
    }))
}

/// An atom that holds, or one that does not.
struct Literal<'a> {
    name: &'a str,
    terms: &'a [Term],
    holds: bool,
}

impl<'a> Literal<'a> {
    /// The literal that an effect makes true.
    fn made(effect: &'a Effect) -> Option<Self> {
        match effect {
            Effect::Add(name, terms) => Some(Self { name, terms, holds: true }),
            Effect::Del(name, terms) => Some(Self { name, terms, holds: false }),
            _ => None,
        }
    }
}

/// What has to be equal for two lists of terms to be one; `None` where they never are.
fn unify(left: &[Term], right: &[Term]) -> Option<Vec<Formula>> {
    let mut equalities = Vec::new();
    for (left, right) in left.iter().zip(right) {
        match (left, right) {
            (left, right) if left == right => {}
            (Term::Const(_), Term::Const(_)) => return None,
            (left, right) => equalities.push(Formula::Eq(left.clone(), right.clone())),
        }
    }
    Some(equalities)
}

/// The effects that happen together.
pub(super) fn parts(effect: &Effect) -> Vec<&Effect> {
    match effect {
        Effect::And(inner) => inner.iter().flat_map(parts).collect(),
        other => vec![other],
    }
}

pub(super) fn conjuncts(formula: &Formula) -> Vec<&Formula> {
    match formula {
        Formula::And(inner) => inner.iter().flat_map(conjuncts).collect(),
        other => vec![other],
    }
}

/// Whether one of the conditions of an effect is of a kind.
fn looks(effect: &Effect, is_one: &dyn Fn(&Formula) -> bool) -> bool {
    match effect {
        Effect::When(condition, inner) => is_one(condition) || looks(inner, is_one),
        Effect::Forall(_, inner) => looks(inner, is_one),
        Effect::And(inner) => inner.iter().any(|part| looks(part, is_one)),
        Effect::Add(..) | Effect::Del(..) | Effect::Num(..) => false,
    }
}

/// The predicates and functions that an effect changes.
pub(super) fn changed(effect: &Effect) -> Vec<&str> {
    match effect {
        Effect::Add(name, _) | Effect::Del(name, _) | Effect::Num(_, name, ..) => vec![name],
        Effect::And(inner) => inner.iter().flat_map(changed).collect(),
        Effect::When(_, inner) | Effect::Forall(_, inner) => changed(inner),
    }
}

/// Whether an effect adds to a value or takes from it.
fn is_sum(effect: &Effect) -> bool {
    matches!(effect, Effect::Num(AssignOp::Increase | AssignOp::Decrease, ..))
}

/// Whether one of the amounts of an effect depends on a value that other effects change.
fn reads_any(effect: &Effect, others: &[&Effect]) -> bool {
    match effect {
        Effect::Num(_, _, _, amount) => {
            let mut read = HashSet::new();
            of_expression(amount, &mut read);
            others.iter().any(|other| changed(other).iter().any(|name| read.contains(*name)))
        }
        Effect::When(_, inner) | Effect::Forall(_, inner) => reads_any(inner, others),
        Effect::And(inner) => inner.iter().any(|part| reads_any(part, others)),
        Effect::Add(..) | Effect::Del(..) => false,
    }
}

/// Whether an effect changes a predicate or a function of a formula.
fn changes_any(effect: &Effect, formula: &Formula) -> bool {
    let changed = changed(effect);
    let mut is_changed = false;
    predicates(formula, &mut |name| is_changed |= changed.contains(&name));
    let mut compared = HashSet::new();
    of_formula(formula, &mut compared);
    is_changed || changed.iter().any(|name| compared.contains(*name))
}

/// Calls `each` with every predicate of a formula.
pub(super) fn predicates<'f>(formula: &'f Formula, each: &mut dyn FnMut(&'f str)) {
    match formula {
        Formula::Atom(name, _) => each(name),
        Formula::And(inner) | Formula::Or(inner) => inner.iter().for_each(|part| predicates(part, each)),
        Formula::Not(inner) | Formula::Forall(_, inner) | Formula::Exists(_, inner) | Formula::Pref(_, inner) => {
            predicates(inner, each);
        }
        Formula::Comp(..) | Formula::Eq(..) | Formula::True | Formula::False => {}
    }
}
