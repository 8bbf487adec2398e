//! A plan as moments in time, and what happens at each.

use std::collections::HashSet;

use super::change::{Changes, is_continuous, without_numbers};
use super::error::EvaluationError;
use super::interference::{Effects, interfering};
use super::record::Pending;
use super::state::{Bindings, Ground, State, TOLERANCE};
use super::trace::{Event, Happening};
use super::trajectory::Trajectory;
use super::truth::at_moment;
use super::verdict::Failure;
use crate::formats::pddl::ast::{Comparator, Moment};
use crate::pddl::domain::Action;
use crate::pddl::model::{Formula, Number};

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
    /// Whether it began before the initial state.
    pub(super) is_running: bool,
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

impl Point {
    fn step(self) -> Option<usize> {
        match self {
            Self::Whole(step) | Self::Start(step) | Self::End(step) => Some(step),
            Self::Literal(_) => None,
        }
    }
}

/// Lets a plan happen in `state`, as the trajectory constraints see it.
pub(super) fn simulate(
    state: &mut State<'_>,
    instances: &[Instance<'_>],
    trajectory: &mut Trajectory,
) -> Result<(), Stop> {
    let points = points(state, instances);
    let mut running = state.begin(instances)?;
    let mut rest = points.as_slice();
    see(trajectory, state, None, instances)?;
    while let Some((time, _)) = rest.first() {
        let count = rest.iter().take_while(|(other, _)| other - time <= SAME_TIME).count();
        let (now, later) = rest.split_at(count);
        state.time = *time;
        happen(state, instances, now, &mut running)?;
        see(trajectory, state, now.iter().rev().find_map(|(_, point)| point.step()), instances)?;
        rest = later;
    }
    state.duration = None;
    // What the world does by itself after the last action is no part of the plan's time.
    let ends = instances.iter().map(|instance| instance.start + instance.duration.unwrap_or_default());
    state.time = ends.fold(0.0, f64::max);
    Ok(())
}

/// Shows the state to the constraints.
fn see(
    trajectory: &mut Trajectory,
    state: &mut State<'_>,
    step: Option<usize>,
    instances: &[Instance<'_>],
) -> Result<(), Stop> {
    state.duration = None;
    match trajectory.see(state).map_err(|error| stop(error, step, instances))? {
        Some(constraint) => Err(Stop::failure(Failure::Constraint { step, constraint })),
        None => Ok(()),
    }
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
                if !instance.is_running {
                    points.push((instance.start, Point::Start(step)));
                }
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
    for (place, (_, point)) in now.iter().enumerate() {
        let read = state.point(instances, *point, alone);
        effects.push(read.map_err(|stop| state.at_this_moment(stop, instances, now, place))?);
    }
    if !alone {
        for effect in &mut effects {
            let expanded = state.derived_reads(&mut effect.reads);
            expanded.map_err(|error| stop(error, effect.step, instances))?;
        }
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
            Point::End(step) => {
                running.retain(|other| other != step);
                state.pending.remove(step);
            }
            Point::Whole(_) | Point::Literal(_) => {}
        }
    }
    running.iter().try_for_each(|step| state.invariant(instances, *step))
}

impl State<'_> {
    /// The same failure, with what else happens at the moment and makes the condition true, too late for it.
    fn at_this_moment(&mut self, stop: Stop, instances: &[Instance<'_>], now: &[(f64, Point)], place: usize) -> Stop {
        let Stop::Failure(mut failure) = stop else { return stop };
        let blamed = self.blamed.borrow().first().cloned();
        if let (Failure::Precondition { at_once, .. }, Some((formula, bindings))) = (&mut *failure, blamed) {
            let others = now.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, (_, point))| *point);
            *at_once = others.into_iter().find_map(|point| self.makes(point, instances, &formula, &bindings));
        }
        Stop::Failure(failure)
    }

    /// What makes a condition true by happening, as text; nothing where it does not.
    fn makes(
        &mut self,
        point: Point,
        instances: &[Instance<'_>],
        formula: &Formula,
        bindings: &Bindings,
    ) -> Option<String> {
        let (changes, words) = match point {
            Point::Literal(place) => (self.literal(place).changes, "a timed initial literal".to_owned()),
            Point::Whole(step) | Point::Start(step) | Point::End(step) => {
                let instance = instances.get(step)?;
                let (moment, verb) = match point {
                    Point::Start(_) => (Some(Moment::Start), "the start of "),
                    Point::End(_) => (Some(Moment::End), "the end of "),
                    _ => (None, ""),
                };
                let changes = self.changes(&instance.action.body.effect, moment, &mut instance.objects.clone()).ok()?;
                (changes, format!("{verb}step {}, {},", step + 1, instance.text))
            }
        };
        let (facts, values) = (self.facts.clone(), self.values.clone());
        let is_made = self.apply(changes).is_ok() && self.is_true(formula, &mut bindings.clone()) == Ok(true);
        (self.facts, self.values) = (facts, values);
        self.derived.replace(None);
        is_made.then_some(words)
    }
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
        let adds = changes.adds.iter().filter(|fact| !self.facts.contains(fact.as_ref())).collect();
        let is_gone = |fact: &&Ground| self.facts.contains(fact.as_ref()) && !changes.adds.contains(*fact);
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

    /// Lets the steps that began before the initial state be under way in it, and returns them.
    fn begin(&mut self, instances: &[Instance<'_>]) -> Result<Vec<usize>, Stop> {
        let is_under_way = |instance: &Instance<'_>| instance.is_running && instance.duration.is_some();
        let running = instances.iter().enumerate().filter(|(_, instance)| is_under_way(instance));
        let running: Vec<usize> = running.map(|(step, _)| step).collect();
        for step in &running {
            let Some(instance) = instances.get(*step) else { continue };
            check_continuous(instance)?;
            self.duration = instance.duration;
            // Numbers were measured since; to change them once more would be wrong.
            let effect = without_numbers(&instance.action.body.effect);
            let mut bindings = instance.objects.clone();
            let mut pending = Vec::new();
            let found = self.find_pending(&instance.action.body.effect, &mut bindings, &mut pending);
            found.map_err(|error| stop(error, Some(*step), instances))?;
            if !pending.is_empty() {
                let reason = format!("what the effects of {} depend on at its start is not known", instance.text);
                return Err(Stop::Unchecked(reason));
            }
            let changes = self.changes(&effect, Some(Moment::Start), &mut bindings);
            let changes = changes.map_err(|error| stop(error, Some(*step), instances))?;
            self.apply(changes).map_err(|error| stop(error, Some(*step), instances))?;
        }
        running.iter().try_for_each(|step| self.invariant(instances, *step))?;
        Ok(running)
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
        if let Some(moment) = moment {
            self.check_duration(moment, step, instance, instances)?;
        }
        let part;
        let condition = match moment {
            None => &body.condition,
            Some(moment) => {
                part = at_moment(&body.condition, moment);
                &part
            }
        };
        // An action without duration that is under way may have begun to undo what it needed.
        if moment.is_some() || !instance.is_running {
            self.demand(condition, &mut bindings, step, instances)?;
        }
        let counted = self.count_violations(&body.condition, moment, &bindings, Some(step));
        counted.map_err(|error| stop(error, Some(step), instances))?;
        let changes = self.changes(&body.effect, moment, &mut bindings);
        let mut changes = changes.map_err(|error| stop(error, Some(step), instances))?;
        let pending = match moment {
            Some(Moment::Start) => self.pend(&body.effect, step, &mut bindings),
            Some(Moment::End) => self.end_pending(step, &mut changes),
            _ => Ok(()),
        };
        pending.map_err(|error| stop(error, Some(step), instances))?;
        let mut reads = HashSet::new();
        if !alone {
            let noted = self.reads(condition, &mut bindings, &mut reads);
            let noted = noted.and_then(|()| self.effect_reads(&body.effect, moment, &mut bindings, &mut reads));
            let duration = moment.zip(body.duration.as_ref()).map(|(moment, duration)| at_moment(duration, moment));
            let noted = noted.and_then(|()| match &duration {
                Some(duration) => self.reads(duration, &mut bindings, &mut reads),
                None => Ok(()),
            });
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
                let action = text(instances, step);
                Err(Stop::failure(Failure::Precondition { step, action, condition, at_once: None }))
            }
            Err(error) => Err(stop(error, Some(step), instances)),
        }
    }

    fn check_duration(
        &mut self,
        moment: Moment,
        step: usize,
        instance: &Instance<'_>,
        all: &[Instance<'_>],
    ) -> Result<(), Stop> {
        check_continuous(instance)?;
        let Some(duration) = &instance.action.body.duration else { return Ok(()) };
        self.tolerance = DURATION_TOLERANCE;
        let mut bindings = instance.objects.clone();
        let checked = self.demand(&at_moment(duration, moment), &mut bindings, step, all);
        self.tolerance = TOLERANCE;
        match (checked, instance.duration) {
            (Err(Stop::Failure(failure)), Some(duration)) => Err(Stop::failure(match *failure {
                Failure::Precondition { step, action, condition, .. } => {
                    let wanted = self.wanted_duration();
                    Failure::Duration { step, action, duration, condition, wanted }
                }
                other => other,
            })),
            (checked, _) => checked,
        }
    }

    /// What the false part of a duration's condition asks for: a comparison and its value.
    fn wanted_duration(&self) -> Option<(Comparator, f64)> {
        let blamed = self.blamed.borrow();
        match blamed.first() {
            Some((Formula::Compare(comparator, Number::Duration, value), bindings)) => {
                Some((*comparator, self.number(value, bindings).ok()?))
            }
            _ => None,
        }
    }

    /// What must hold all the time a running action takes.
    fn invariant(&mut self, instances: &[Instance<'_>], step: usize) -> Result<(), Stop> {
        let Some(instance) = instances.get(step) else { return Ok(()) };
        self.duration = instance.duration;
        let condition = at_moment(&instance.action.body.condition, Moment::All);
        self.demand(&condition, &mut instance.objects.clone(), step, instances)?;
        let error = |error| stop(error, Some(step), instances);
        let preferences = &instance.action.body.condition;
        self.count_violations(preferences, Some(Moment::All), &instance.objects, Some(step)).map_err(error)?;
        let Some(mut pending) = self.pending.remove(&step) else { return Ok(()) };
        for Pending { condition, bindings, holds, .. } in &mut pending {
            *holds = *holds && self.is_true(&at_moment(condition, Moment::All), bindings).map_err(error)?;
        }
        self.pending.insert(step, pending);
        Ok(())
    }
}

/// Refuses an action whose effects happen little by little.
fn check_continuous(instance: &Instance<'_>) -> Result<(), Stop> {
    match is_continuous(&instance.action.body.effect) {
        true => Err(Stop::Unchecked(format!("the effects of `{}` are continuous", instance.action.name()))),
        false => Ok(()),
    }
}

/// What happens at one time must not be about the same facts, unless all only look.
fn check_interference(effects: &[Effects], instances: &[Instance<'_>]) -> Result<(), Stop> {
    let Some((one, other)) = interfering(effects) else { return Ok(()) };
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
