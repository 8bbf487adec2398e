//! A plan as moments in time, and what happens at each.

use std::collections::HashSet;

use super::change::{Changes, is_continuous};
use super::state::{Bindings, Ground, TOLERANCE, Trouble, World};
use super::truth::at_moment;
use super::verdict::Failure;
use crate::formats::pddl::ast::Moment;
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
}

/// Why a simulation ended early.
pub(super) enum Stop {
    Failure(Box<Failure>),
    Unjudged(String),
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

/// Lets a plan happen in `world`.
pub(super) fn simulate(world: &mut World<'_>, instances: &[Instance<'_>]) -> Result<(), Stop> {
    let points = points(world, instances);
    let mut running: Vec<usize> = Vec::new();
    let mut rest = points.as_slice();
    while let Some((time, _)) = rest.first() {
        let count = rest.iter().take_while(|(other, _)| other - time <= SAME_TIME).count();
        let (now, later) = rest.split_at(count);
        world.time = *time;
        happen(world, instances, now, &mut running)?;
        rest = later;
    }
    world.duration = None;
    Ok(())
}

/// All points in order of time; at one time, in the order of the plan.
fn points(world: &World<'_>, instances: &[Instance<'_>]) -> Vec<(f64, Point)> {
    let mut points = Vec::with_capacity(instances.len());
    for (place, (time, _, _)) in world.problem.start.timed.iter().enumerate() {
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
    world: &mut World<'_>,
    instances: &[Instance<'_>],
    now: &[(f64, Point)],
    running: &mut Vec<usize>,
) -> Result<(), Stop> {
    let alone = now.len() == 1;
    let mut effects = Vec::with_capacity(now.len());
    for (_, point) in now {
        effects.push(world.point(instances, *point, alone)?);
    }
    if !alone {
        check_interference(&effects, instances)?;
    }
    let mut all = Changes::default();
    let mut last = None;
    for Effects { step, changes, .. } in effects {
        last = step.or(last);
        all.join(changes, world).map_err(|trouble| stop(trouble, step, instances))?;
    }
    world.apply(all).map_err(|trouble| stop(trouble, last, instances))?;
    for (_, point) in now {
        match point {
            Point::Start(step) => running.push(*step),
            Point::End(step) => running.retain(|other| other != step),
            Point::Whole(_) | Point::Literal(_) => {}
        }
    }
    running.iter().try_for_each(|step| world.invariant(instances, *step))
}

impl World<'_> {
    /// Checks what a point needs, and says what it changes.
    fn point(&mut self, instances: &[Instance<'_>], point: Point, alone: bool) -> Result<Effects, Stop> {
        let (step, moment) = match point {
            Point::Literal(place) => return Ok(self.literal(place)),
            Point::Whole(step) => (step, None),
            Point::Start(step) => (step, Some(Moment::Start)),
            Point::End(step) => (step, Some(Moment::End)),
        };
        let Some(instance) = instances.get(step) else {
            return Err(Stop::Unjudged("a step is missing".to_owned()));
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
        let changes = self
            .changes(&body.effect, moment, &mut bindings)
            .map_err(|trouble| stop(trouble, Some(step), instances))?;
        let mut reads = HashSet::new();
        if !alone {
            self.reads(condition, &mut bindings, &mut reads).map_err(|trouble| stop(trouble, Some(step), instances))?;
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
            Ok(false) => self.fault(condition, bindings),
            Err(trouble) => Err(trouble),
        };
        match fault {
            Ok(condition) => {
                Err(Stop::failure(Failure::Precondition { step, action: text(instances, step), condition }))
            }
            Err(trouble) => Err(stop(trouble, Some(step), instances)),
        }
    }

    fn check_duration(&mut self, step: usize, instance: &Instance<'_>, all: &[Instance<'_>]) -> Result<(), Stop> {
        if is_continuous(&instance.action.body.effect) {
            return Err(Stop::Unjudged(format!("the effects of `{}` are continuous", instance.action.name())));
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
    fn reads(&self, formula: &Formula, bindings: &mut Bindings, reads: &mut HashSet<Ground>) -> Result<(), Trouble> {
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

    fn number_reads(&self, number: &Number, bindings: &Bindings, reads: &mut HashSet<Ground>) -> Result<(), Trouble> {
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

/// What happens at one time must not be about the same facts, unless all only look.
fn check_interference(effects: &[Effects], instances: &[Instance<'_>]) -> Result<(), Stop> {
    for (place, one) in effects.iter().enumerate() {
        for other in effects.iter().skip(place + 1) {
            if (interferes(one, other) || interferes(other, one))
                && let Some(step) = one.step.max(other.step)
            {
                let with = one.step.min(other.step);
                let with = with.map_or_else(|| "a timed initial literal".to_owned(), |with| text(instances, with));
                return Err(Stop::failure(Failure::Interference { step, action: text(instances, step), with }));
            }
        }
    }
    Ok(())
}

fn interferes(one: &Effects, other: &Effects) -> bool {
    let touches = |fact: &Ground| other.changes.adds.contains(fact) || other.changes.deletes.contains(fact);
    let is_changed = |fluent: &Ground| other.changes.values.contains_key(fluent);
    one.reads.iter().any(|fact| touches(fact) || is_changed(&function_key(fact)))
        || one.changes.adds.iter().any(|fact| other.changes.deletes.contains(fact))
}

fn text(instances: &[Instance<'_>], step: usize) -> String {
    instances.get(step).map_or_else(String::new, |instance| instance.text.clone())
}

/// A trouble at a step as an end of the simulation.
fn stop(trouble: Trouble, step: Option<usize>, instances: &[Instance<'_>]) -> Stop {
    match trouble {
        Trouble::Unjudged(reason) => Stop::Unjudged(reason),
        Trouble::Wrong(reason) => {
            let action = step.map_or_else(String::new, |step| text(instances, step));
            Stop::failure(Failure::Number { step, action, reason })
        }
    }
}
