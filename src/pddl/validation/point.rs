//! A point of a plan: an action, or the start or the end of one, or a timed initial literal. What it needs, and what it
//! changes.

use std::collections::HashSet;

use super::change::{Changes, is_continuous};
use super::error::EvaluationError;
use super::interference::Effects;
use super::record::Pending;
use super::state::{Bindings, State, TOLERANCE};
use super::truth::at_moment;
use super::verdict::Failure;
use crate::formats::pddl::ast::{Comparator, Moment};
use crate::pddl::domain::Action;
use crate::pddl::model::{Formula, Number};

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
pub(super) enum Point {
    /// An action without duration.
    Whole(usize),
    Start(usize),
    End(usize),
    /// A timed initial literal, by its place.
    Literal(usize),
}

impl Point {
    /// The step that it is of.
    pub(super) fn step(self) -> Option<usize> {
        match self {
            Self::Whole(step) | Self::Start(step) | Self::End(step) => Some(step),
            Self::Literal(_) => None,
        }
    }
}

impl State<'_> {
    /// Checks what a point needs, and says what it changes.
    pub(super) fn point(&mut self, instances: &[Instance<'_>], point: Point, alone: bool) -> Result<Effects, Stop> {
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

    pub(super) fn literal(&self, place: usize) -> Effects {
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
    pub(super) fn invariant(&mut self, instances: &[Instance<'_>], step: usize) -> Result<(), Stop> {
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
pub(super) fn check_continuous(instance: &Instance<'_>) -> Result<(), Stop> {
    match is_continuous(&instance.action.body.effect) {
        true => Err(Stop::Unchecked(format!("the effects of `{}` are continuous", instance.action.name()))),
        false => Ok(()),
    }
}

/// A step as text.
pub(super) fn text(instances: &[Instance<'_>], step: usize) -> String {
    instances.get(step).map_or_else(String::new, |instance| instance.text.clone())
}

/// An error at a step as an end of the simulation.
pub(super) fn stop(error: EvaluationError, step: Option<usize>, instances: &[Instance<'_>]) -> Stop {
    match error {
        EvaluationError::Unchecked(reason) => Stop::Unchecked(reason),
        EvaluationError::Wrong(reason) => {
            let action = step.map_or_else(String::new, |step| text(instances, step));
            Stop::failure(Failure::Number { step, action, reason })
        }
    }
}
