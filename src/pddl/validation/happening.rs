//! A plan as moments in time, and what happens at each.

use super::change::{Changes, without_numbers};
use super::interference::{Effects, interfering};
use super::point::{Instance, Point, Stop, check_continuous, stop, text};
use super::state::{Bindings, State};
use super::trajectory::Trajectory;
use super::verdict::Failure;
use crate::formats::pddl::ast::Moment;
use crate::pddl::model::Formula;

/// Moments closer than this are one.
const SAME_TIME: f64 = 1e-6;

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

impl State<'_> {
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
