//! A task whose durative actions need no concurrency, by the search for classical tasks.
//!
//! Each durative action becomes an action that happens at once (it is compressed, Coles, Fox, Long and Smith 2009): it
//! needs what the durative one needs at any time and does not bring about itself, and it leaves what that one leaves. The
//! plan is a right one, one step after the other; then the steps are moved to where they may start first.

use std::collections::{HashMap, HashSet};

use ferroplan::types::{Action, Domain, DurativeAction, Effect, Expr, Formula, Problem, Term, TimeSpec};
use ferroplan::{Plan, Step};

use super::convert::convert;
use super::options::Options;
use super::search::makespan::{Timing, hasten};
use super::search::task::{OperatorId, Task};
use super::search::{End, Event, Ground, Improvement, Settings, ground, solve};

/// Units of time in a second: plans are written in thousandths.
const UNITS: f64 = 1000.0;

/// The length of the longest action in estimates.
const FINENESS: u64 = 16;

/// The work for a plan, after which the engine has its turn.
const WORK: u64 = 2_000_000_000;

/// The work for a plan that ends earlier, where improvement is bounded: about a third of a second.
const HASTE: u64 = 12_000_000;

/// Finds plans, each ending before the one before; `false` where there is none, or the task is not one of these.
pub(super) fn plan(
    domain: &Domain,
    problem: &Problem,
    options: Options,
    memory: usize,
    found: &mut dyn FnMut(&Plan),
) -> bool {
    if domain.durative_actions.is_empty() || !problem.til.is_empty() || !domain.derived.is_empty() {
        return false;
    }
    let (flat, instance) = compressed(domain, problem);
    let Ok(lifted) = convert(&flat, &instance) else { return false };
    let Ok(Ground::Task(mut task)) = ground(&lifted, memory, &mut |_, _| {}) else { return false };
    let Some(mut timing) = Clock::new(domain, problem).timing(&task) else { return false };
    let settings = Settings { improvement: Improvement::Brief, memory, work: WORK };
    let mut first = None;
    let end = solve(&task, settings, &mut |event| {
        if let Event::Plan(plan) = event {
            first = Some(plan.to_vec());
        }
    });
    let (Some(mut best), End::Solved) = (first, end) else { return false };
    if options.says_each() {
        found(&report(&task, &timing, &best));
    }
    estimate(&mut task, &mut timing);
    let work = if options.anytime { u64::MAX } else { HASTE };
    let (_, end) = timing.schedule(&best);
    hasten(&task, &timing, end, work, memory, &mut |plan| {
        best = plan.to_vec();
        if options.says_each() {
            found(&report(&task, &timing, plan));
        }
    });
    if !options.says_each() {
        found(&report(&task, &timing, &best));
    }
    true
}

/// Makes durations the costs of operators, in units of which the longest has [`FINENESS`].
fn estimate(task: &mut Task, timing: &mut Timing) {
    timing.unit = (timing.durations.iter().copied().max().unwrap_or(0) / FINENESS).max(1);
    for (operator, duration) in task.operators.iter_mut().zip(&timing.durations) {
        operator.cost = (duration / timing.unit).saturating_sub(1) as f64;
    }
}

fn report(task: &Task, timing: &Timing, plan: &[OperatorId]) -> Plan {
    let (starts, end) = timing.schedule(plan);
    let mut order: Vec<(u64, OperatorId)> = starts.into_iter().zip(plan.iter().copied()).collect();
    order.sort_by_key(|(start, _)| *start);
    let step = |(index, (start, operator)): (usize, &(u64, OperatorId))| {
        let mut words = task.name(*operator).map(str::to_owned);
        let duration = timing.durations[*operator as usize] as f64 / UNITS;
        Step {
            index,
            action: words.next().unwrap_or_default(),
            args: words.collect(),
            time: Some(*start as f64 / UNITS),
            duration: Some(duration),
        }
    };
    let steps: Vec<Step> = order.iter().enumerate().map(step).collect();
    Plan { length: steps.len(), steps, metric: None, makespan: Some(end as f64 / UNITS) }
}

/// The task with actions that happen at once, without a metric.
fn compressed(domain: &Domain, problem: &Problem) -> (Domain, Problem) {
    let (mut domain, mut problem) = (domain.clone(), problem.clone());
    let actions: Vec<Action> = domain.durative_actions.drain(..).map(|action| compress(&action)).collect();
    domain.actions.extend(actions);
    problem.metric = None;
    (domain, problem)
}

fn compress(action: &DurativeAction) -> Action {
    let at =
        |time: TimeSpec| action.effects.iter().filter(move |(at, _)| *at == time).flat_map(|(_, effect)| parts(effect));
    let starting: Vec<&Effect> = at(TimeSpec::Start).collect();
    let ending: Vec<&Effect> = at(TimeSpec::End).collect();
    let mut conditions = Vec::new();
    for (time, formula) in &action.conditions {
        let needed = conjuncts(formula).into_iter();
        // What the start brings about holds during the action.
        conditions.extend(needed.filter(|part| *time == TimeSpec::Start || !brings(&starting, part)).cloned());
    }
    let stays = |effect: &&Effect| match effect {
        Effect::Add(name, terms) => {
            !ending.iter().any(|end| matches!(end, Effect::Del(n, t) if n == name && t == terms))
        }
        _ => true,
    };
    let effects = starting.iter().copied().filter(stays).chain(ending.iter().copied()).cloned();
    Action {
        name: action.name.clone(),
        params: action.params.clone(),
        precond: Formula::And(conditions),
        effect: Effect::And(effects.collect()),
        monitored: false,
    }
}

fn parts(effect: &Effect) -> Vec<&Effect> {
    match effect {
        Effect::And(inner) => inner.iter().flat_map(parts).collect(),
        other => vec![other],
    }
}

fn conjuncts(formula: &Formula) -> Vec<&Formula> {
    match formula {
        Formula::And(inner) => inner.iter().flat_map(conjuncts).collect(),
        other => vec![other],
    }
}

/// Whether effects make a literal true.
fn brings(effects: &[&Effect], literal: &Formula) -> bool {
    effects.iter().any(|effect| match (effect, literal) {
        (Effect::Add(name, terms), Formula::Atom(n, t)) => n == name && t == terms,
        (Effect::Del(name, terms), Formula::Not(inner)) => {
            matches!(&**inner, Formula::Atom(n, t) if n == name && t == terms)
        }
        _ => false,
    })
}

/// A ground atom, or, of a predicate that occurs under a quantifier, all of its atoms.
type Resource = (String, Vec<String>);

/// What actions touch, and for how long.
struct Clock<'a> {
    actions: HashMap<&'a str, Touched<'a>>,
    values: HashMap<(&'a str, Vec<&'a str>), f64>,
    /// The predicates that are not told apart by their arguments.
    coarse: HashSet<&'a str>,
    /// The predicates and functions that actions change.
    changed: HashSet<&'a str>,
}

struct Touched<'a> {
    parameters: Vec<&'a str>,
    duration: Option<&'a Expr>,
    is_durative: bool,
    reads: Vec<(&'a str, &'a [Term])>,
    writes: Vec<(&'a str, &'a [Term])>,
}

impl<'a> Clock<'a> {
    fn new(domain: &'a Domain, problem: &'a Problem) -> Self {
        let mut clock = Self {
            actions: HashMap::new(),
            values: problem
                .init_fluents
                .iter()
                .map(|((name, arguments), value)| {
                    ((name.as_str(), arguments.iter().map(String::as_str).collect()), *value)
                })
                .collect(),
            coarse: HashSet::new(),
            changed: HashSet::new(),
        };
        for action in &domain.durative_actions {
            let mut touched = Touched::new(&action.params, action.duration.chosen(), true);
            for (_, condition) in &action.conditions {
                clock.condition(condition, false, &mut touched);
            }
            for (_, effect) in &action.effects {
                clock.effect(effect, false, &mut touched);
            }
            clock.actions.insert(&action.name, touched);
        }
        for action in &domain.actions {
            let mut touched = Touched::new(&action.params, None, false);
            clock.condition(&action.precond, false, &mut touched);
            clock.effect(&action.effect, false, &mut touched);
            clock.actions.insert(&action.name, touched);
        }
        clock
    }

    fn condition(&mut self, formula: &'a Formula, is_quantified: bool, touched: &mut Touched<'a>) {
        match formula {
            Formula::Atom(name, terms) => {
                touched.reads.push((name, terms));
                self.coarse.extend(is_quantified.then_some(name.as_str()));
            }
            Formula::And(inner) | Formula::Or(inner) => {
                inner.iter().for_each(|part| self.condition(part, is_quantified, touched));
            }
            Formula::Not(inner) => self.condition(inner, is_quantified, touched),
            Formula::Forall(_, inner) | Formula::Exists(_, inner) => self.condition(inner, true, touched),
            _ => {}
        }
    }

    fn effect(&mut self, effect: &'a Effect, is_quantified: bool, touched: &mut Touched<'a>) {
        match effect {
            Effect::Add(name, terms) | Effect::Del(name, terms) => {
                touched.writes.push((name, terms));
                self.changed.insert(name);
                self.coarse.extend(is_quantified.then_some(name.as_str()));
            }
            Effect::Num(_, name, ..) => drop(self.changed.insert(name)),
            Effect::And(inner) => inner.iter().for_each(|part| self.effect(part, is_quantified, touched)),
            Effect::When(condition, inner) => {
                self.condition(condition, is_quantified, touched);
                self.effect(inner, is_quantified, touched);
            }
            Effect::Forall(_, inner) => self.effect(inner, true, touched),
        }
    }

    /// What the operators of a task touch; `None` where a duration depends on the state, or has no value.
    fn timing(&self, task: &'a Task) -> Option<Timing> {
        let mut numbers: HashMap<Resource, u32> = HashMap::new();
        let mut timing = Timing { gap: 1, ..Timing::default() };
        for operator in 0..task.operators.len() as OperatorId {
            let mut words = task.name(operator);
            let action = self.actions.get(words.next()?)?;
            let binding: HashMap<&str, &str> = action.parameters.iter().copied().zip(words).collect();
            let duration = match action.duration {
                Some(duration) => self.value(duration, &binding)?,
                None if action.is_durative => return None,
                None => 0.0,
            };
            if !(0.0..1e12).contains(&duration) {
                return None;
            }
            timing.durations.push((duration * UNITS).round() as u64);
            let mut list = |atoms: &[(&'a str, &'a [Term])]| {
                let atoms = atoms.iter().filter(|(name, _)| self.changed.contains(name));
                let mut resources: Vec<u32> = atoms
                    .map(|(name, terms)| {
                        let is_coarse = self.coarse.contains(name);
                        let arguments =
                            terms.iter().filter(|_| !is_coarse).map(|term| object(term, &binding).to_owned());
                        let next = numbers.len() as u32;
                        *numbers.entry(((*name).to_owned(), arguments.collect())).or_insert(next)
                    })
                    .collect();
                resources.sort_unstable();
                resources.dedup();
                resources
            };
            let (reads, writes) = (list(&action.reads), list(&action.writes));
            timing.reads.push(reads);
            timing.writes.push(writes);
        }
        timing.resources = numbers.len();
        Some(timing)
    }

    fn value(&self, expression: &'a Expr, binding: &HashMap<&'a str, &'a str>) -> Option<f64> {
        Some(match expression {
            Expr::Num(number) => *number,
            Expr::Fluent(name, _) if self.changed.contains(name.as_str()) => return None,
            Expr::Fluent(name, terms) => {
                let objects = terms.iter().map(|term| object(term, binding)).collect();
                *self.values.get(&(name.as_str(), objects))?
            }
            Expr::Add(left, right) => self.value(left, binding)? + self.value(right, binding)?,
            Expr::Sub(left, right) => self.value(left, binding)? - self.value(right, binding)?,
            Expr::Mul(left, right) => self.value(left, binding)? * self.value(right, binding)?,
            Expr::Div(left, right) => self.value(left, binding)? / self.value(right, binding)?,
            Expr::Neg(inner) => -self.value(inner, binding)?,
        })
    }
}

impl<'a> Touched<'a> {
    fn new(parameters: &'a [(String, String)], duration: Option<&'a Expr>, is_durative: bool) -> Self {
        let parameters = parameters.iter().map(|(name, _)| name.as_str()).collect();
        Self { parameters, duration, is_durative, reads: Vec::new(), writes: Vec::new() }
    }
}

fn object<'t>(term: &'t Term, binding: &HashMap<&str, &'t str>) -> &'t str {
    match term {
        Term::Const(name) => name,
        Term::Var(name) => binding.get(name.as_str()).copied().unwrap_or(name),
    }
}

#[cfg(test)]
mod tests {
    use ferroplan::parser::{parse_domain, parse_problem};

    use super::*;

    fn plans(domain: &str, problem: &str) -> Vec<Plan> {
        let (domain, problem) = (parse_domain(domain).unwrap(), parse_problem(problem).unwrap());
        let mut plans = Vec::new();
        plan(&domain, &problem, Options::default(), 1 << 26, &mut |plan| plans.push(plan.clone()));
        plans
    }

    fn fixture(name: &str) -> String {
        std::fs::read_to_string(format!("{}/fixtures/tasks/{name}.pddl", env!("CARGO_MANIFEST_DIR"))).unwrap()
    }

    #[test]
    fn two_robots_carry_four_boxes_in_half_the_time_of_one() {
        let plans = plans(&fixture("delivery/domain"), &fixture("delivery/problem"));
        // Twice load, go, unload (3 + 8 + 2), and once back (8), with a thousandth between them.
        assert_eq!(plans.last().and_then(|plan| plan.makespan), Some(34.006));
    }

    #[test]
    fn an_action_that_another_one_has_to_be_within_is_left_to_the_engine() {
        // There is light only while a match burns.
        let domain =
            "(define (domain cellar) (:requirements :strips :durative-actions) (:predicates (light) (dark) (fixed))
            (:durative-action burn :parameters () :duration (= ?duration 5) :condition (at start (dark))
              :effect (and (at start (light)) (at end (not (light)))))
            (:durative-action fix :parameters () :duration (= ?duration 3) :condition (over all (light))
              :effect (at end (fixed))))";
        let problem = "(define (problem fuse) (:domain cellar) (:init (dark)) (:goal (fixed)))";
        assert_eq!(plans(domain, problem).len(), 0);
    }

    #[test]
    fn what_an_action_itself_brings_about_it_does_not_need() {
        let domain = "(define (domain oven) (:requirements :strips :durative-actions) (:predicates (hot) (baked))
            (:durative-action bake :parameters () :duration (= ?duration 5) :condition (over all (hot))
              :effect (and (at start (hot)) (at end (baked)))))";
        let problem = "(define (problem bread) (:domain oven) (:init) (:goal (baked)))";
        assert_eq!(plans(domain, problem).last().and_then(|plan| plan.makespan), Some(5.0));
    }

    #[test]
    fn a_resource_that_is_given_back_is_used_by_one_at_a_time() {
        let domain = "(define (domain print) (:requirements :strips :typing :durative-actions) (:types page)
            (:predicates (free) (printed ?p - page))
            (:durative-action print :parameters (?p - page) :duration (= ?duration 2) :condition (at start (free))
              :effect (and (at start (not (free))) (at end (free)) (at end (printed ?p)))))";
        let problem = "(define (problem two) (:domain print) (:objects a b - page) (:init (free))
            (:goal (and (printed a) (printed b))))";
        assert_eq!(plans(domain, problem).last().and_then(|plan| plan.makespan), Some(4.001));
    }
}
