//! A plan as moments in time, and what happens at each.

use std::collections::{HashMap, HashSet};

use super::change::{Changes, is_continuous};
use super::error::EvaluationError;
use super::state::{Bindings, Ground, State, TOLERANCE};
use super::trace::{Event, Happening};
use super::truth::at_moment;
use super::verdict::Failure;
use crate::formats::pddl::ast::Moment;
use crate::pddl::domain::Action;
use crate::pddl::model::{Change, Formula, Number};

/// Moments closer than this are one.
const SAME_TIME: f64 = 1e-6;

/// How far a plan's duration may be from what the action says: plans print few decimals.
const DURATION_TOLERANCE: f64 = 0.01;

/// A step of a plan whose action and objects are known.
pub(super) struct Instance<'a> {
    pub(super) action: &'a Action,
    pub(super) objects: Vec<u32>,
    pub(super) start: f64,
    /// Of a durative action.
    pub(super) duration: Option<f64>,
    /// `(pick r1 ball)`, as the domain and problem spell it.
    pub(super) text: String,
}

/// Why a simulation ended early.
pub(super) enum Stop {
    Failure(Box<Failure>),
    Unchecked(String),
}

impl Stop {
    pub(super) fn failure(failure: Failure) -> Self {
        Self::Failure(Box::new(failure))
    }
}

/// What happens at a moment.
#[derive(Clone, Copy)]
enum Point {
    /// An action without duration.
    Whole(usize),
    Start(usize),
    End(usize),
    /// A timed initial literal, by its place.
    Literal(usize),
}

/// One point with what it reads and changes.
struct Effects {
    step: Option<usize>,
    reads: HashSet<Ground>,
    changes: Changes,
}

/// Lets a plan happen in `state`.
pub(super) fn simulate(state: &mut State<'_>, instances: &[Instance<'_>]) -> Result<(), Stop> {
    let points = points(state, instances);
    let mut running: Vec<usize> = Vec::new();
    let mut rest = points.as_slice();
    while let Some((time, _)) = rest.first() {
        let count = rest.iter().take_while(|(other, _)| other - time <= SAME_TIME).count();
        let (now, later) = rest.split_at(count);
        state.time = *time;
        happen(state, instances, now, &mut running)?;
        rest = later;
    }
    state.duration = None;
    Ok(())
}

/// All points in order of time; at one time, in the order of the plan.
fn points(state: &State<'_>, instances: &[Instance<'_>]) -> Vec<(f64, Point)> {
    let mut points = Vec::with_capacity(instances.len());
    for (place, (time, _, _)) in state.problem.start.timed.iter().enumerate() {
        points.push((*time, Point::Literal(place)));
    }
    for (step, instance) in instances.iter().enumerate() {
        match instance.duration {
            None => points.push((instance.start, Point::Whole(step))),
            Some(duration) => {
                points.push((instance.start, Point::Start(step)));
                points.push((instance.start + duration, Point::End(step)));
            }
        }
    }
    points.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    points
}

fn happen(
    state: &mut State<'_>,
    instances: &[Instance<'_>],
    now: &[(f64, Point)],
    running: &mut Vec<usize>,
) -> Result<(), Stop> {
    let alone = now.len() == 1;
    let mut effects = Vec::with_capacity(now.len());
    for (_, point) in now {
        effects.push(state.point(instances, *point, alone)?);
    }
    if !alone {
        check_interference(&effects, instances)?;
    }
    let mut all = Changes::default();
    let mut last = None;
    for Effects { step, changes, .. } in effects {
        last = step.or(last);
        if let Some(history) = &mut state.history {
            history.extend(changes.deletes.iter().map(|fact| (fact.clone(), (step, false))));
            history.extend(changes.adds.iter().map(|fact| (fact.clone(), (step, true))));
        }
        all.join(changes, state).map_err(|error| stop(error, step, instances))?;
    }
    let mut noted = state.trace.is_some().then(|| state.noted(&all, instances, now));
    state.apply(all).map_err(|error| stop(error, last, instances))?;
    if let (Some(noted), Some(mut trace)) = (noted.take(), state.trace.take()) {
        trace.push(state.with_values(noted));
        state.trace = Some(trace);
    }
    for (_, point) in now {
        match point {
            Point::Start(step) => running.push(*step),
            Point::End(step) => running.retain(|other| other != step),
            Point::Whole(_) | Point::Literal(_) => {}
        }
    }
    running.iter().try_for_each(|step| state.invariant(instances, *step))
}

/// A moment that is noted, and the numbers that it changes.
struct Noted {
    happening: Happening,
    values: Vec<Ground>,
}

impl State<'_> {
    /// What happens now, and what it is about to change.
    fn noted(&self, changes: &Changes, instances: &[Instance<'_>], now: &[(f64, Point)]) -> Noted {
        let texts = |facts: Vec<&Ground>| {
            let mut texts: Vec<String> = facts.into_iter().map(|fact| self.fact_text(fact)).collect();
            texts.sort();
            texts
        };
        let event = |(_, point): &(f64, Point)| match point {
            Point::Whole(step) => Event::Action(text(instances, *step)),
            Point::Start(step) => Event::Start(text(instances, *step)),
            Point::End(step) => Event::End(text(instances, *step)),
            Point::Literal(_) => Event::Literal,
        };
        let adds = changes.adds.iter().filter(|fact| !self.facts.contains(*fact)).collect();
        let is_gone = |fact: &&Ground| self.facts.contains(*fact) && !changes.adds.contains(*fact);
        let mut values: Vec<(String, Ground)> =
            changes.values.keys().map(|fluent| (self.ground_function_text(fluent), fluent.clone())).collect();
        values.sort();
        let before = |fluent: &Ground| self.values.get(fluent).copied();
        Noted {
            happening: Happening {
                time: self.time,
                events: now.iter().map(event).collect(),
                becomes_true: texts(adds),
                becomes_false: texts(changes.deletes.iter().filter(is_gone).collect()),
                values: values.iter().map(|(text, fluent)| (text.clone(), before(fluent), 0.0)).collect(),
            },
            values: values.into_iter().map(|(_, fluent)| fluent).collect(),
        }
    }

    /// The moment with the values that numbers have after it.
    fn with_values(&self, noted: Noted) -> Happening {
        let Noted { mut happening, values } = noted;
        for (entry, fluent) in happening.values.iter_mut().zip(&values) {
            entry.2 = self.values.get(fluent).copied().unwrap_or_default();
        }
        happening
    }

    /// Checks what a point needs, and says what it changes.
    fn point(&mut self, instances: &[Instance<'_>], point: Point, alone: bool) -> Result<Effects, Stop> {
        let (step, moment) = match point {
            Point::Literal(place) => return Ok(self.literal(place)),
            Point::Whole(step) => (step, None),
            Point::Start(step) => (step, Some(Moment::Start)),
            Point::End(step) => (step, Some(Moment::End)),
        };
        let Some(instance) = instances.get(step) else {
            return Err(Stop::Unchecked("a step is missing".to_owned()));
        };
        self.duration = instance.duration;
        let mut bindings: Bindings = instance.objects.clone();
        let body = &instance.action.body;
        if moment == Some(Moment::Start) {
            self.check_duration(step, instance, instances)?;
        }
        let part;
        let condition = match moment {
            None => &body.condition,
            Some(moment) => {
                part = at_moment(&body.condition, moment);
                &part
            }
        };
        self.demand(condition, &mut bindings, step, instances)?;
        let changes =
            self.changes(&body.effect, moment, &mut bindings).map_err(|error| stop(error, Some(step), instances))?;
        let mut reads = HashSet::new();
        if !alone {
            let noted = self.reads(condition, &mut bindings, &mut reads);
            let noted = noted.and_then(|()| self.effect_reads(&body.effect, moment, &mut bindings, &mut reads));
            noted.map_err(|error| stop(error, Some(step), instances))?;
        }
        Ok(Effects { step: Some(step), reads, changes })
    }

    fn literal(&self, place: usize) -> Effects {
        let mut changes = Changes::default();
        if let Some((_, becomes, fact)) = self.problem.start.timed.get(place) {
            let facts = if *becomes { &mut changes.adds } else { &mut changes.deletes };
            facts.insert(fact.clone());
        }
        Effects { step: None, reads: HashSet::new(), changes }
    }

    fn demand(
        &self,
        condition: &Formula,
        bindings: &mut Bindings,
        step: usize,
        instances: &[Instance<'_>],
    ) -> Result<(), Stop> {
        let fault = match self.is_true(condition, bindings) {
            Ok(true) => return Ok(()),
            Ok(false) => self.faulty(condition, bindings),
            Err(error) => Err(error),
        };
        match fault {
            Ok(part) => {
                let condition = self.blame(&[part]).concat();
                Err(Stop::failure(Failure::Precondition { step, action: text(instances, step), condition }))
            }
            Err(error) => Err(stop(error, Some(step), instances)),
        }
    }

    fn check_duration(&mut self, step: usize, instance: &Instance<'_>, all: &[Instance<'_>]) -> Result<(), Stop> {
        if is_continuous(&instance.action.body.effect) {
            return Err(Stop::Unchecked(format!("the effects of `{}` are continuous", instance.action.name())));
        }
        let Some(duration) = &instance.action.body.duration else { return Ok(()) };
        self.tolerance = DURATION_TOLERANCE;
        let mut bindings = instance.objects.clone();
        let checked = self.demand(&at_moment(duration, Moment::Start), &mut bindings, step, all);
        self.tolerance = TOLERANCE;
        checked
    }

    /// What must hold all the time a running action takes.
    fn invariant(&mut self, instances: &[Instance<'_>], step: usize) -> Result<(), Stop> {
        let Some(instance) = instances.get(step) else { return Ok(()) };
        self.duration = instance.duration;
        let condition = at_moment(&instance.action.body.condition, Moment::All);
        self.demand(&condition, &mut instance.objects.clone(), step, instances)
    }

    /// The facts and values that a condition looks at. Under a derived predicate, that is the predicate itself.
    fn reads(
        &self,
        formula: &Formula,
        bindings: &mut Bindings,
        reads: &mut HashSet<Ground>,
    ) -> Result<(), EvaluationError> {
        match formula {
            Formula::Fact(fact) => {
                reads.insert(self.ground(fact.predicate, &fact.arguments, bindings)?);
                Ok(())
            }
            Formula::Compare(_, left, right) => {
                self.number_reads(left, bindings, reads)?;
                self.number_reads(right, bindings, reads)
            }
            Formula::And(parts) | Formula::Or(parts) => {
                parts.iter().try_for_each(|part| self.reads(part, bindings, reads))
            }
            Formula::Imply(left, right) => {
                self.reads(left, bindings, reads)?;
                self.reads(right, bindings, reads)
            }
            Formula::Not(inner) | Formula::Timed(_, inner) => self.reads(inner, bindings, reads),
            Formula::Forall(quantifier, inner) | Formula::Exists(quantifier, inner) => self
                .each(quantifier, bindings, |bindings| {
                    self.reads(inner, bindings, reads)?;
                    Ok(false)
                })
                .map(drop),
            Formula::Same(..) | Formula::Preference(_) | Formula::Modal => Ok(()),
        }
    }

    /// The facts and values that an effect looks at.
    fn effect_reads(
        &self,
        change: &Change,
        moment: Option<Moment>,
        bindings: &mut Bindings,
        reads: &mut HashSet<Ground>,
    ) -> Result<(), EvaluationError> {
        match change {
            Change::And(parts) => parts.iter().try_for_each(|part| self.effect_reads(part, moment, bindings, reads)),
            Change::Timed(when, inner) if moment.is_none_or(|moment| moment == *when) => {
                self.effect_reads(inner, moment, bindings, reads)
            }
            Change::Forall(quantifier, inner) => self
                .each(quantifier, bindings, |bindings| {
                    self.effect_reads(inner, moment, bindings, reads)?;
                    Ok(false)
                })
                .map(drop),
            Change::When(condition, inner) => {
                self.reads(condition, bindings, reads)?;
                self.effect_reads(inner, moment, bindings, reads)
            }
            Change::Assign(_, _, value) => self.number_reads(value, bindings, reads),
            Change::Timed(..) | Change::Add(_) | Change::Delete(_) | Change::AssignObject => Ok(()),
        }
    }

    fn number_reads(
        &self,
        number: &Number,
        bindings: &Bindings,
        reads: &mut HashSet<Ground>,
    ) -> Result<(), EvaluationError> {
        match number {
            Number::Fluent(fluent) => {
                let ground = self.ground(fluent.function, &fluent.arguments, bindings)?;
                reads.insert(function_key(&ground));
                Ok(())
            }
            Number::Operation(_, operands) => {
                operands.iter().try_for_each(|operand| self.number_reads(operand, bindings, reads))
            }
            _ => Ok(()),
        }
    }
}

/// A function among facts: its number is counted from the other end, so that it is no predicate's.
fn function_key(ground: &Ground) -> Ground {
    let mut key = ground.clone();
    if let Some(function) = key.first_mut() {
        *function = !*function;
    }
    key
}

/// The steps that read, add and delete each fact, and that read and change each number, at one time.
#[derive(Default)]
struct Uses<'e> {
    reads: HashMap<&'e Ground, Vec<usize>>,
    changes: HashMap<Ground, Vec<(usize, Touch)>>,
}

/// How a fact is touched.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Touch {
    Added,
    Deleted,
    /// A number got another value; conflicting changes are found when the changes are joined.
    Computed,
}

/// What happens at one time must not be about the same facts, unless all only look.
fn check_interference(effects: &[Effects], instances: &[Instance<'_>]) -> Result<(), Stop> {
    let mut uses = Uses::default();
    for (place, Effects { reads, changes, .. }) in effects.iter().enumerate() {
        for fact in reads {
            uses.reads.entry(fact).or_default().push(place);
        }
        let adds = changes.adds.iter().map(|fact| (fact.clone(), Touch::Added));
        let deletes = changes.deletes.iter().map(|fact| (fact.clone(), Touch::Deleted));
        let values = changes.values.keys().map(|fluent| (function_key(fluent), Touch::Computed));
        for (fact, touch) in adds.chain(deletes).chain(values) {
            uses.changes.entry(fact).or_default().push((place, touch));
        }
    }
    // Of several, the first in the plan is reported.
    let mut worst: Option<(usize, usize)> = None;
    let mut note = |one: usize, other: usize| {
        let pair = (one.min(other), one.max(other));
        let has_step =
            [pair.0, pair.1].iter().any(|place| effects.get(*place).is_some_and(|effect| effect.step.is_some()));
        if has_step && worst.is_none_or(|worst| pair < worst) {
            worst = Some(pair);
        }
    };
    for (fact, touches) in &uses.changes {
        let readers = uses.reads.get(fact).map_or(&[][..], Vec::as_slice);
        // A pair is enough: one of the first that touch it, which are two at least, with another that reads or undoes it.
        for (place, touch) in touches.iter().take(3) {
            if let Some(reader) = readers.iter().find(|reader| *reader != place) {
                note(*place, *reader);
            }
            let undoes = |(other, how): &&(usize, Touch)| {
                other != place
                    && matches!((touch, how), (Touch::Added, Touch::Deleted) | (Touch::Deleted, Touch::Added))
            };
            if let Some((other, _)) = touches.iter().find(undoes) {
                note(*place, *other);
            }
        }
    }
    let Some((one, other)) = worst else { return Ok(()) };
    let step = |place: usize| effects.get(place).and_then(|effect| effect.step);
    let (first, second) = (step(one).min(step(other)), step(one).max(step(other)));
    let with = first.map_or_else(|| "a timed initial literal".to_owned(), |with| text(instances, with));
    let step = second.unwrap_or_default();
    Err(Stop::failure(Failure::Interference { step, action: text(instances, step), with }))
}

fn text(instances: &[Instance<'_>], step: usize) -> String {
    instances.get(step).map_or_else(String::new, |instance| instance.text.clone())
}

/// An error at a step as an end of the simulation.
fn stop(error: EvaluationError, step: Option<usize>, instances: &[Instance<'_>]) -> Stop {
    match error {
        EvaluationError::Unchecked(reason) => Stop::Unchecked(reason),
        EvaluationError::Wrong(reason) => {
            let action = step.map_or_else(String::new, |step| text(instances, step));
            Stop::failure(Failure::Number { step, action, reason })
        }
    }
}
