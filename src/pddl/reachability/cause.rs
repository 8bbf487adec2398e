//! From what can never hold back to what is missing.

use std::collections::VecDeque;

use super::explanation::{Achiever, Obstacle, Why};
use super::relaxed::Relaxed;
use super::rule::{Makes, Rule, is_of_another};
use crate::formats::pddl::ast::Moment;
use crate::pddl::model::{Arg, Change, Fact, Formula, Variable};
use crate::pddl::validation::{Bindings, EvaluationError, UNBOUND, free_slots, predicates};

/// How many conditions of the goal are listed.
const GOALS: usize = 6;
/// How many conditions are listed in all.
const OBSTACLES: usize = 12;
/// How many actions are listed that would meet a condition.
const ACHIEVERS: usize = 4;
/// How many conditions of an action are listed.
const MISSING: usize = 4;

/// A fact, or its absence, with the objects that are known.
#[derive(Clone, PartialEq)]
struct Target {
    predicate: u32,
    /// None where any object will do.
    objects: Vec<Option<u32>>,
    /// Whether it has to become false.
    absent: bool,
}

/// Says what stands between what can be reached and the goal.
pub(super) fn explain(relaxed: &Relaxed<'_>) -> Result<Why, EvaluationError> {
    let mut search = Search { relaxed, why: Why::default(), seen: Vec::new(), todo: VecDeque::new() };
    for part in conjuncts(&relaxed.state.problem.goal) {
        if search.why.goals >= GOALS {
            break;
        }
        search.goal(part)?;
    }
    while let Some((target, condition)) = search.todo.pop_front() {
        if search.why.obstacles.len() >= OBSTACLES {
            break;
        }
        let achievers = search.achievers(&target)?;
        search.why.obstacles.push(Obstacle { condition, achievers });
    }
    search.why.unfilled = unfilled(relaxed);
    Ok(search.why)
}

/// What has to hold, each by itself.
fn conjuncts(formula: &Formula) -> Vec<&Formula> {
    let (mut found, mut todo) = (Vec::new(), vec![formula]);
    while let Some(formula) = todo.pop() {
        match formula {
            Formula::And(parts) => todo.extend(parts.iter().rev()),
            Formula::Timed(_, inner) => todo.push(inner),
            other => found.push(other),
        }
    }
    found
}

/// The predicates that conditions of actions and rules ask for and that are never true of anything.
fn unfilled(relaxed: &Relaxed<'_>) -> Vec<String> {
    let mut found: Vec<u32> = Vec::new();
    let mut note = |predicate: u32, negated: bool| {
        if !negated && !relaxed.is_filled(predicate) && !found.contains(&predicate) {
            found.push(predicate);
        }
    };
    let domain = relaxed.state.domain;
    domain.actions().iter().for_each(|action| predicates(&action.body.condition, &mut note));
    domain.rules.iter().for_each(|rule| predicates(&rule.condition, &mut note));
    let names = found.into_iter().filter_map(|number| domain.vocabulary.predicates.get(number));
    names.map(|predicate| predicate.name.as_str().to_owned()).collect()
}

struct Search<'r, 'a> {
    relaxed: &'r Relaxed<'a>,
    why: Why,
    seen: Vec<Target>,
    /// Conditions that have to be looked into, with their texts.
    todo: VecDeque<(Target, String)>,
}

/// A condition that can never hold.
#[derive(PartialEq)]
struct Lack {
    text: String,
    /// What to look into, where it is a fact.
    target: Option<Target>,
}

/// An effect that may make a fact true or false, and what it depends on.
struct Effect<'e> {
    fact: &'e Fact,
    absent: bool,
    conditions: Vec<&'e Formula>,
    /// The variables of the quantifiers around it, with their slots.
    variables: Vec<(u32, &'e Variable)>,
}

impl Search<'_, '_> {
    /// Notes a condition of the goal that can never hold.
    fn goal(&mut self, formula: &Formula) -> Result<(), EvaluationError> {
        if self.relaxed.can_hold(formula, &mut Bindings::new())? {
            return Ok(());
        }
        let condition = self.relaxed.state.open_text(formula, &Bindings::new(), &[]);
        let achievers = match target(formula, &Bindings::new()) {
            Some(target) => {
                self.seen.push(target.clone());
                self.achievers(&target)?
            }
            None => Vec::new(),
        };
        self.why.obstacles.push(Obstacle { condition, achievers });
        self.why.goals += 1;
        Ok(())
    }

    /// What would meet a condition, and what it lacks; that is looked into later.
    fn achievers(&mut self, target: &Target) -> Result<Vec<Achiever>, EvaluationError> {
        let mut found: Vec<(String, Vec<Lack>)> = Vec::new();
        for rule in &self.relaxed.rules {
            for effect in effects(rule) {
                let Some(objects) = self.unify(rule, &effect, target) else { continue };
                let new = (self.call(rule, &objects), self.missing(rule, &effect, &objects)?);
                if !found.contains(&new) {
                    found.push(new);
                }
            }
        }
        found.sort_by_key(|(_, lacks)| lacks.len());
        found.truncate(ACHIEVERS);
        let mut achievers = Vec::with_capacity(found.len());
        for (action, lacks) in found {
            let missing = lacks.iter().map(|lack| lack.text.clone()).collect();
            achievers.push(Achiever { action, missing });
            for Lack { text, target } in lacks {
                if let Some(target) = target.filter(|target| !self.seen.contains(target)) {
                    self.seen.push(target.clone());
                    self.todo.push_back((target, text));
                }
            }
        }
        Ok(achievers)
    }

    /// The objects that make an effect one on the target.
    fn unify(&self, rule: &Rule<'_>, effect: &Effect<'_>, target: &Target) -> Option<Bindings> {
        if effect.absent != target.absent || effect.fact.predicate != target.predicate {
            return None;
        }
        let slots = effect.variables.iter().map(|(slot, _)| *slot as usize + 1).max().unwrap_or_default();
        let mut objects: Bindings = vec![UNBOUND; slots.max(rule.variables.len())];
        for (argument, wanted) in effect.fact.arguments.iter().zip(&target.objects) {
            match (argument, wanted) {
                (Arg::Object(number), Some(wanted)) if number != wanted => return None,
                (Arg::Slot(slot), Some(wanted)) => {
                    let bound = effect.variables.iter().find(|(other, _)| other == slot);
                    let variable =
                        bound.map(|(_, variable)| *variable).or_else(|| rule.variables.get(*slot as usize))?;
                    let value = objects.get_mut(*slot as usize)?;
                    if !self.relaxed.state.is_member(*wanted, &variable.kind)
                        || (*value != UNBOUND && *value != *wanted)
                    {
                        return None;
                    }
                    *value = *wanted;
                }
                _ => {}
            }
        }
        Some(objects)
    }

    /// What keeps a rule from ever being applied to these objects.
    fn missing(&self, rule: &Rule<'_>, effect: &Effect<'_>, objects: &Bindings) -> Result<Vec<Lack>, EvaluationError> {
        let state = &self.relaxed.state;
        let mut lacks = Vec::new();
        for (variable, object) in rule.variables.iter().zip(objects) {
            if *object == UNBOUND && state.members(&variable.kind).is_empty() {
                let text = format!("an object of type {}", state.domain.vocabulary.types.kind_text(&variable.kind));
                lacks.push(Lack { text, target: None });
            }
        }
        let facts: Vec<Formula> = rule.facts.iter().map(|fact| Formula::Fact((*fact).clone())).collect();
        let further = effect.conditions.iter().flat_map(|condition| conjuncts(condition));
        for part in facts.iter().chain(rule.rest.iter().copied()).chain(further) {
            if lacks.len() < MISSING && !self.may_hold(part, objects)? {
                let mut text = state.open_text(part, objects, rule.variables);
                if let Formula::Compare(_, left, right) = part
                    && let Some(reason) = self.relaxed.fault([left, right], objects)?
                {
                    text = format!("{text}: {reason}");
                }
                lacks.push(Lack { text, target: target(part, objects) });
            }
        }
        Ok(lacks)
    }

    /// Whether a condition can hold for some choice of the objects that are not known.
    fn may_hold(&self, formula: &Formula, objects: &Bindings) -> Result<bool, EvaluationError> {
        if let Formula::Fact(fact) = formula {
            return Ok(self.relaxed.matches(fact, objects).any(|candidate| agrees(fact, candidate, objects)));
        }
        let mut slots = Vec::new();
        free_slots(formula, u32::try_from(objects.len()).unwrap_or(u32::MAX), &mut slots);
        let is_open = slots.iter().any(|slot| objects.get(*slot as usize).is_none_or(|object| *object == UNBOUND));
        // With open variables it may hold for some; only what is certain is reported.
        Ok(is_open || self.relaxed.can_hold(formula, &mut objects.clone())?)
    }

    /// A rule as the call of an action.
    fn call(&self, rule: &Rule<'_>, objects: &Bindings) -> String {
        let name = match (rule.action, &rule.makes) {
            (Some(name), _) => name,
            (None, Makes::Derived(head)) => {
                let predicate = self.relaxed.state.domain.vocabulary.predicates.get(head.predicate);
                predicate.map_or("?", |predicate| predicate.name.as_str())
            }
            (None, Makes::Effect(..)) => "?",
        };
        let words = rule.variables.iter().zip(objects).map(|(variable, object)| {
            let object = self.relaxed.state.problem.objects.get(*object);
            object.map_or_else(|| variable.name.as_str().to_owned(), |object| object.name.as_str().to_owned())
        });
        let call = std::iter::once(name.to_owned()).chain(words).collect::<Vec<_>>().join(" ");
        if rule.action.is_some() { format!("({call})") } else { format!("the rule of ({call})") }
    }
}

/// What a condition asks for, where it is a fact or the absence of one.
fn target(formula: &Formula, objects: &Bindings) -> Option<Target> {
    let (fact, absent) = match formula {
        Formula::Fact(fact) => (fact, false),
        Formula::Not(inner) => match inner.as_ref() {
            Formula::Fact(fact) => (fact, true),
            _ => return None,
        },
        _ => return None,
    };
    let object = |argument: &Arg| match argument {
        Arg::Object(number) => Some(*number),
        Arg::Slot(slot) => objects.get(*slot as usize).copied().filter(|object| *object != UNBOUND),
        Arg::Fluent => None,
    };
    Some(Target { predicate: fact.predicate, objects: fact.arguments.iter().map(object).collect(), absent })
}

/// Whether a reachable fact is the one asked for; the same variable is the same object.
fn agrees(fact: &Fact, candidate: &[u32], objects: &Bindings) -> bool {
    let mut objects = objects.clone();
    fact.arguments.iter().zip(candidate.iter().skip(1)).all(|(argument, object)| match argument {
        Arg::Object(number) => number == object,
        Arg::Fluent => true,
        Arg::Slot(slot) => match objects.get_mut(*slot as usize) {
            Some(value) if *value == UNBOUND => {
                *value = *object;
                true
            }
            Some(value) => value == object,
            None => true,
        },
    })
}

/// The effects of a rule on facts.
fn effects<'e>(rule: &'e Rule<'_>) -> Vec<Effect<'e>> {
    match &rule.makes {
        Makes::Effect(change, moment) => {
            let mut found = Vec::new();
            collect(change, *moment, &mut Vec::new(), &mut Vec::new(), &mut found);
            found
        }
        Makes::Derived(head) => {
            vec![Effect { fact: head, absent: false, conditions: Vec::new(), variables: Vec::new() }]
        }
    }
}

fn collect<'e>(
    change: &'e Change,
    moment: Option<Moment>,
    conditions: &mut Vec<&'e Formula>,
    variables: &mut Vec<(u32, &'e Variable)>,
    found: &mut Vec<Effect<'e>>,
) {
    let mut note = |fact: &'e Fact, absent: bool| {
        found.push(Effect { fact, absent, conditions: conditions.clone(), variables: variables.clone() });
    };
    match change {
        Change::Add(fact) => note(fact, false),
        Change::Delete(fact) => note(fact, true),
        Change::And(parts) => parts.iter().for_each(|part| collect(part, moment, conditions, variables, found)),
        Change::Timed(at, _) if is_of_another(*at, moment) => {}
        Change::Timed(_, inner) => collect(inner, moment, conditions, variables, found),
        Change::When(condition, inner) => {
            conditions.push(condition);
            collect(inner, moment, conditions, variables, found);
            conditions.pop();
        }
        Change::Forall(quantifier, inner) => {
            let outer = variables.len();
            variables.extend((quantifier.first..).zip(&quantifier.variables));
            collect(inner, moment, conditions, variables, found);
            variables.truncate(outer);
        }
        Change::Assign(..) | Change::AssignObject => {}
    }
}
