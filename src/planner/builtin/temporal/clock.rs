//! What the operators of a temporal task touch, how long they take, and when they may start.

use std::collections::{BTreeMap, HashMap, HashSet};

use ferroplan::types::{Domain, Duration, Effect, Expr, Formula, Problem, Term, TimeSpec};

use super::compress::is_momentary;
use super::shared::{self, Sharing};
use super::windows::{Limit, UNITS, Window, Windows, intersected};
use crate::planner::builtin::search::makespan::{self, Timing};
use crate::planner::builtin::search::reservoir::Draw;
use crate::planner::builtin::search::task::{OperatorId, Task};

/// A ground atom or the value of a function for some objects, or, of a predicate or function that occurs under a quantifier,
/// all of them.
type Resource = (String, Vec<String>);

/// What actions touch, and for how long.
pub(super) struct Clock<'a> {
    actions: HashMap<&'a str, Touched<'a>>,
    values: HashMap<(&'a str, Vec<&'a str>), f64>,
    /// The predicates that are not told apart by their arguments.
    coarse: HashSet<&'a str>,
    /// The predicates and functions that actions change.
    changed: HashSet<&'a str>,
    /// The functions that matter to what happens.
    compared: HashSet<String>,
    /// Those of them that actions may share.
    shared: HashSet<&'a str>,
    windows: Windows<'a>,
    /// When the actions happen that are timed literals.
    moments: HashMap<String, u64>,
}

struct Touched<'a> {
    parameters: Vec<&'a str>,
    /// Of a durative action.
    duration: Option<&'a Duration>,
    reads: Vec<Touch<'a>>,
    writes: Vec<Touch<'a>>,
    limits: Vec<Limit<'a>>,
    sharing: Vec<Sharing<'a>>,
    /// When it happens by itself.
    moment: Option<u64>,
}

/// An atom or a value that a part of an action is about.
#[derive(Clone, Copy)]
struct Touch<'a> {
    time: TimeSpec,
    name: &'a str,
    terms: &'a [Term],
}

impl<'a> Clock<'a> {
    /// `compared` are the functions that conditions compare, and those that change them; `moments` is when actions happen that
    /// are timed literals.
    pub(super) fn new(
        domain: &'a Domain,
        problem: &'a Problem,
        windows: Windows<'a>,
        compared: HashSet<String>,
        moments: HashMap<String, u64>,
    ) -> Self {
        let mut clock = Self {
            windows,
            compared,
            moments,
            shared: HashSet::new(),
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
            let mut touched = Touched::new(&action.params, Some(&action.duration));
            let counts = |time: &TimeSpec| *time != TimeSpec::All || !is_momentary(action);
            for (time, condition) in action.conditions.iter().filter(|(time, _)| counts(time)) {
                touched.limits.extend(clock.windows.limits(*time, condition));
                clock.condition(*time, condition, false, &mut touched);
            }
            for (time, effect) in &action.effects {
                clock.effect(*time, effect, false, &mut touched);
            }
            clock.actions.insert(&action.name, touched);
        }
        for action in &domain.actions {
            let mut touched = Touched::new(&action.params, None);
            touched.limits.extend(clock.windows.limits(TimeSpec::Start, &action.precond));
            clock.condition(TimeSpec::Start, &action.precond, false, &mut touched);
            clock.effect(TimeSpec::Start, &action.effect, false, &mut touched);
            touched.moment = clock.moments.get(&action.name).copied();
            clock.actions.insert(&action.name, touched);
        }
        clock.shared = shared::functions(domain, &clock.changed);
        clock.shared.retain(|name| clock.compared.contains(*name));
        for (name, sharing) in shared::of_actions(domain, &clock.shared) {
            if let Some(touched) = clock.actions.get_mut(name) {
                touched.sharing = sharing;
            }
        }
        clock
    }

    fn condition(&mut self, time: TimeSpec, formula: &'a Formula, is_quantified: bool, touched: &mut Touched<'a>) {
        match formula {
            Formula::Atom(name, terms) => {
                touched.reads.push(Touch { time, name, terms });
                self.coarse.extend(is_quantified.then_some(name.as_str()));
            }
            Formula::And(inner) | Formula::Or(inner) => {
                inner.iter().for_each(|part| self.condition(time, part, is_quantified, touched));
            }
            Formula::Not(inner) => self.condition(time, inner, is_quantified, touched),
            Formula::Forall(_, inner) | Formula::Exists(_, inner) => self.condition(time, inner, true, touched),
            Formula::Comp(_, left, right) => {
                self.number(time, left, is_quantified, touched);
                self.number(time, right, is_quantified, touched);
            }
            _ => {}
        }
    }

    fn number(&mut self, time: TimeSpec, expression: &'a Expr, is_quantified: bool, touched: &mut Touched<'a>) {
        match expression {
            Expr::Num(_) => {}
            Expr::Fluent(name, terms) => {
                touched.reads.push(Touch { time, name, terms });
                self.coarse.extend(is_quantified.then_some(name.as_str()));
            }
            Expr::Add(left, right) | Expr::Sub(left, right) | Expr::Mul(left, right) | Expr::Div(left, right) => {
                self.number(time, left, is_quantified, touched);
                self.number(time, right, is_quantified, touched);
            }
            Expr::Neg(inner) => self.number(time, inner, is_quantified, touched),
        }
    }

    fn effect(&mut self, time: TimeSpec, effect: &'a Effect, is_quantified: bool, touched: &mut Touched<'a>) {
        match effect {
            Effect::Add(name, terms) | Effect::Del(name, terms) => {
                touched.writes.push(Touch { time, name, terms });
                self.changed.insert(name);
                self.coarse.extend(is_quantified.then_some(name.as_str()));
            }
            Effect::Num(_, name, terms, amount) => {
                self.changed.insert(name);
                // Values that nothing depends on may be changed at any time.
                if self.compared.contains(name) {
                    touched.writes.push(Touch { time, name, terms });
                    self.coarse.extend(is_quantified.then_some(name.as_str()));
                    self.number(time, amount, is_quantified, touched);
                }
            }
            Effect::And(inner) => inner.iter().for_each(|part| self.effect(time, part, is_quantified, touched)),
            Effect::When(condition, inner) => {
                self.condition(time, condition, is_quantified, touched);
                self.effect(time, inner, is_quantified, touched);
            }
            Effect::Forall(_, inner) => self.effect(time, inner, true, touched),
        }
    }

    /// Drops the operators that no duration or no time suits; `None` where a duration depends on the state, or has no
    /// bound.
    pub(super) fn limit(&self, task: &mut Task) -> Option<()> {
        let is_known = |duration: &Duration| {
            let bounds = || duration.min.iter().chain(&duration.max);
            bounds().next().is_some() && !bounds().any(|bound| self.depends(bound))
        };
        if !self.actions.values().filter_map(|action| action.duration).all(is_known) {
            return None;
        }
        let is_possible = |operator| {
            let duration = self.duration(task, operator);
            duration
                .is_some_and(|duration| self.starts(task, operator, duration).is_none_or(|starts| !starts.is_empty()))
        };
        let mut is_possible = (0..task.operators.len() as OperatorId).map(is_possible).collect::<Vec<_>>().into_iter();
        task.operators.retain(|_| is_possible.next().unwrap_or_default());
        Some(())
    }

    /// The action of an operator, with the objects of its parameters.
    fn instance<'t>(&self, task: &'t Task, operator: OperatorId) -> Option<(&Touched<'a>, HashMap<&'a str, &'t str>)> {
        let mut words = task.name(operator);
        let action = self.actions.get(words.next()?)?;
        Some((action, action.parameters.iter().copied().zip(words).collect()))
    }

    /// How many units an operator takes; `None` where no duration suits it.
    fn duration(&self, task: &Task, operator: OperatorId) -> Option<u64> {
        let (action, binding) = self.instance(task, operator)?;
        let Some(duration) = action.duration else { return Some(0) };
        let value = |bound: &'a Option<Expr>| bound.as_ref().map(|bound| self.value(bound, &binding));
        let (least, most) = (value(&duration.min), value(&duration.max));
        let chosen = least.or(most)??;
        let is_short = |chosen: f64| most.is_none_or(|most| most.is_some_and(|most| chosen <= most));
        if !(is_short(chosen) && (0.0..1e12).contains(&chosen)) {
            return None;
        }
        match (chosen * UNITS).round() as u64 {
            0 if self.interferes(action, &binding) => is_short(1.0 / UNITS).then_some(1),
            units => Some(units),
        }
    }

    /// Whether the start and the end of an action cannot happen at one moment.
    fn interferes(&self, action: &Touched<'a>, binding: &HashMap<&str, &str>) -> bool {
        let is_one = |touch: &Touch<'a>, other: &Touch<'a>| {
            let same = |(one, other)| object(one, binding) == object(other, binding);
            touch.name == other.name
                && (self.coarse.contains(touch.name) || touch.terms.iter().zip(other.terms).all(same))
        };
        let parts = || action.writes.iter().chain(action.reads.iter().filter(|read| read.time != TimeSpec::All));
        action.writes.iter().any(|write| parts().any(|other| write.time != other.time && is_one(write, other)))
    }

    /// Whether the value of an expression changes.
    fn depends(&self, expression: &Expr) -> bool {
        match expression {
            Expr::Num(_) => false,
            Expr::Fluent(name, _) => self.changed.contains(name.as_str()),
            Expr::Add(left, right) | Expr::Sub(left, right) | Expr::Mul(left, right) | Expr::Div(left, right) => {
                self.depends(left) || self.depends(right)
            }
            Expr::Neg(inner) => self.depends(inner),
        }
    }

    /// What the operators of a task touch; `None` where one has no duration.
    pub(super) fn timing(&self, task: &'a Task) -> Option<Timing> {
        let mut numbers: HashMap<Resource, u32> = HashMap::new();
        let mut levels: HashMap<(&str, Vec<&str>), u32> = HashMap::new();
        let mut timing = Timing { gap: 1, ..Timing::default() };
        for operator in 0..task.operators.len() as OperatorId {
            let (action, binding) = self.instance(task, operator)?;
            let duration = self.duration(task, operator)?;
            timing.durations.push(duration);
            if let Some(windows) = self.starts(task, operator, duration) {
                timing.windows.insert(operator, windows);
            }
            let mut list = |touches: &[Touch<'a>]| {
                let mut spans: BTreeMap<u32, (u64, u64)> = BTreeMap::new();
                let counts = |name: &str| self.changed.contains(name) && !self.shared.contains(name);
                for touch in touches.iter().filter(|touch| counts(touch.name)) {
                    let is_coarse = self.coarse.contains(touch.name);
                    let arguments =
                        touch.terms.iter().filter(|_| !is_coarse).map(|term| object(term, &binding).to_owned());
                    let next = numbers.len() as u32;
                    let resource = *numbers.entry((touch.name.to_owned(), arguments.collect())).or_insert(next);
                    let (from, to) = match touch.time {
                        TimeSpec::Start => (0, 0),
                        TimeSpec::All => (0, duration),
                        TimeSpec::End => (duration, duration),
                    };
                    let span = spans.entry(resource).or_insert((from, to));
                    *span = (span.0.min(from), span.1.max(to));
                }
                spans.into_iter().map(|(resource, (from, to))| makespan::Touch { resource, from, to }).collect()
            };
            let (reads, writes) = (list(&action.reads), list(&action.writes));
            timing.reads.push(reads);
            timing.writes.push(writes);
            timing.happening.extend(action.moment.map(|_| operator));
            let mut draws: BTreeMap<u32, Draw> = BTreeMap::new();
            for sharing in &action.sharing {
                let objects: Vec<&str> = sharing.terms.iter().map(|term| object(term, &binding)).collect();
                let key = (sharing.name, objects);
                let level = self.values.get(&key).copied().unwrap_or_default();
                let number = *levels.entry(key).or_insert_with(|| {
                    timing.levels.push(level);
                    timing.levels.len() as u32 - 1
                });
                // What compares with what has no value is never applicable.
                let value = self.value(sharing.amount, &binding).unwrap_or_default();
                sharing.add(value, draws.entry(number).or_insert_with(|| Draw { number, ..Draw::default() }));
            }
            timing.draws.push(draws.into_values().collect());
        }
        timing.resources = numbers.len();
        part(&mut timing);
        Some(timing)
    }

    /// When an operator may start; `None` where it may at any time.
    fn starts(&self, task: &'a Task, operator: OperatorId, duration: u64) -> Option<Vec<Window>> {
        let (action, binding) = self.instance(task, operator)?;
        if let Some(moment) = action.moment {
            return Some(vec![(moment, moment)]);
        }
        let windows = action.limits.iter().map(|limit| {
            let objects = limit.terms.iter().map(|term| object(term, &binding)).collect();
            self.windows.starts(*limit, objects, duration)
        });
        windows.reduce(|one, other| intersected(&one, &other))
    }

    fn value(&self, expression: &'a Expr, binding: &HashMap<&'a str, &'a str>) -> Option<f64> {
        Some(match expression {
            Expr::Num(number) => *number,
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

/// Says which operators the schedule has to keep from running twice at once: those that change nothing for all of their
/// time.
fn part(timing: &mut Timing) {
    let is_alone = |((writes, draws), to): ((&Vec<makespan::Touch>, &Vec<Draw>), &u64)| {
        let is_changing = !writes.is_empty() || draws.iter().any(|draw| draw.at_start != 0.0 || draw.at_end != 0.0);
        is_changing && !writes.iter().any(|touch| touch.from == 0 && touch.to == *to)
    };
    timing.alone = timing.writes.iter().zip(&timing.draws).zip(&timing.durations).map(is_alone).collect();
}

impl<'a> Touched<'a> {
    fn new(parameters: &'a [(String, String)], duration: Option<&'a Duration>) -> Self {
        let parameters = parameters.iter().map(|(name, _)| name.as_str()).collect();
        let (reads, writes) = (Vec::new(), Vec::new());
        Self { parameters, duration, reads, writes, limits: Vec::new(), sharing: Vec::new(), moment: None }
    }
}

fn object<'t>(term: &'t Term, binding: &HashMap<&str, &'t str>) -> &'t str {
    match term {
        Term::Const(name) => name,
        Term::Var(name) => binding.get(name.as_str()).copied().unwrap_or(name),
    }
}
