//! From a plan to its verdict: look up, simulate, check the goal.

use super::error::EvaluationError;
use super::happening::simulate;
use super::point::{Instance, Stop};
use super::state::{Bindings, State};
use super::trace::Happening;
use super::trajectory::Trajectory;
use super::verdict::{Failure, Validation};
use crate::pddl::Step;
use crate::pddl::domain::{Action, Domain};
use crate::pddl::feature::Feature;
use crate::pddl::problem::Problem;

/// How many false conditions of a goal are listed.
const GOAL_LIMIT: usize = 20;

/// Simulates a plan and says whether it reaches the goal.
///
/// Names compare without regard to case. Preferences never make a plan invalid; their violations count in the metric.
#[must_use]
pub fn validate(domain: &Domain, problem: &Problem, steps: &[Step]) -> Validation {
    validate_rest(domain, problem, steps, &[])
}

/// Simulates the rest of a plan of which some steps are `running`; steps count from 0.
///
/// What a running step needs at its start is not asked for, nor its duration. The facts that it changes at its start
/// are changed in the initial state, for the problem may show them or not; its numbers there are as the problem has them.
/// What it needs all the time and at its end, and its effects at the end, count; of an action without duration, all effects.
#[must_use]
pub fn validate_rest(domain: &Domain, problem: &Problem, steps: &[Step], running: &[usize]) -> Validation {
    match verify(&mut State::new(domain, problem), steps, running) {
        Ok(value) => Validation::Valid { value },
        Err(Stop::Failure(failure)) => Validation::Invalid(*failure),
        Err(Stop::Unchecked(reason)) => Validation::Unchecked(reason),
    }
}

/// Simulates a plan and says what happens at each moment, up to where the plan breaks.
#[must_use]
pub fn trace(domain: &Domain, problem: &Problem, steps: &[Step]) -> Vec<Happening> {
    let mut state = State::new(domain, problem);
    state.trace = Some(Vec::new());
    // `validate` reports what is wrong.
    let _ = verify(&mut state, steps, &[]);
    state.trace.unwrap_or_default()
}

/// Lets a plan happen in a state, which is left as it was when the plan broke.
pub(super) fn verify(state: &mut State<'_>, steps: &[Step], running: &[usize]) -> Result<Option<f64>, Stop> {
    let (domain, problem) = (state.domain, state.problem);
    let mut instances = instances(domain, problem, steps)?;
    for (step, instance) in instances.iter_mut().enumerate() {
        instance.is_running = running.contains(&step);
    }
    let fluents = domain.features().iter().chain(problem.features());
    if fluents.into_iter().any(|used| used.feature == Feature::ObjectFluents) {
        return Err(Stop::Unchecked("object fluents are not simulated".to_owned()));
    }
    let mut trajectory = Trajectory::new(state);
    simulate(state, &instances, &mut trajectory)?;
    check_goal(state)?;
    let (broken, violated) = trajectory.end(state);
    if let Some(constraint) = broken {
        return Err(Stop::failure(Failure::Constraint { step: None, constraint }));
    }
    if let Some(reason) = trajectory.unchecked {
        return Err(Stop::Unchecked(reason));
    }
    state.count_violations(&problem.goal, None, &Bindings::new(), None).map_err(stop)?;
    if let Some(violations) = &mut state.violations {
        violated.iter().for_each(|name| violations.add(name));
    }
    Ok(value(state, steps.len(), steps.iter().any(|step| step.start.is_some())))
}

/// An error after the last step as an end of the simulation.
fn stop(error: EvaluationError) -> Stop {
    match error {
        EvaluationError::Unchecked(reason) => Stop::Unchecked(reason),
        EvaluationError::Wrong(reason) => Stop::failure(Failure::Number { step: None, action: String::new(), reason }),
    }
}

fn check_goal(state: &State<'_>) -> Result<(), Stop> {
    if state.is_true(&state.problem.goal, &mut Bindings::new()).map_err(stop)? {
        return Ok(());
    }
    let parts = state.all_faulty(&state.problem.goal, GOAL_LIMIT).map_err(stop)?;
    Err(Stop::failure(Failure::Goal { conditions: state.blame(&parts) }))
}

/// What a plan is measured by: the metric, or else when a plan with times ends, or how many steps there are.
fn value(state: &State<'_>, steps: usize, is_timed: bool) -> Option<f64> {
    match &state.problem.metric {
        Some(metric) => state.number(metric, &Bindings::new()).ok(),
        None if is_timed => Some(state.time),
        None => u32::try_from(steps).ok().map(f64::from),
    }
}

/// The plan's steps with actions and objects looked up.
fn instances<'a>(domain: &'a Domain, problem: &Problem, steps: &[Step]) -> Result<Vec<Instance<'a>>, Stop> {
    let is_timed = steps.iter().any(|step| step.start.is_some());
    let mut instances = Vec::with_capacity(steps.len());
    let mut time = 0.0;
    for (index, step) in steps.iter().enumerate() {
        time += 1.0;
        let (action, objects) = look_up(domain, problem, index, step)?;
        if action.has_locals {
            return Err(Stop::Unchecked(format!("the `:vars` of action `{}` are not simulated", action.name())));
        }
        let start = if is_timed { step.start } else { Some(time) };
        let (start, duration) = times(action, start, step.duration, is_timed)
            .map_err(|reason| Stop::failure(Failure::Time { step: index, action: action.name().to_owned(), reason }))?;
        let text = text(problem, action, &objects);
        instances.push(Instance { action, objects, start, duration, text, is_running: false });
    }
    Ok(instances)
}

/// When a step begins and how long it takes.
fn times(
    action: &Action,
    start: Option<f64>,
    duration: Option<f64>,
    is_timed: bool,
) -> Result<(f64, Option<f64>), &'static str> {
    let Some(start) = start else { return Err("the plan says when other steps begin, but not this one") };
    if !(start.is_finite() && start >= 0.0) {
        return Err("it begins before time 0");
    }
    if !action.is_durative() {
        return Ok((start, None));
    }
    match duration {
        _ if !is_timed => Err("it takes time, but the plan does not say when it begins"),
        Some(duration) if duration.is_finite() && duration >= 0.0 => Ok((start, Some(duration))),
        Some(_) => Err("its duration is negative"),
        None => Err("it takes time, but the plan does not say how long"),
    }
}

fn look_up<'a>(
    domain: &'a Domain,
    problem: &Problem,
    index: usize,
    step: &Step,
) -> Result<(&'a Action, Vec<u32>), Stop> {
    let Some(action) = domain.action(&step.action) else {
        let nearest = domain.nearest_action(&step.action).map(str::to_owned);
        return Err(Stop::failure(Failure::UnknownAction { step: index, action: step.action.clone(), nearest }));
    };
    let (wanted, found) = (action.variables.len(), step.arguments.len());
    if wanted != found {
        return Err(Stop::failure(Failure::Arity { step: index, action: action.name().to_owned(), wanted, found }));
    }
    let mut objects = Vec::with_capacity(found);
    for (argument, variable) in step.arguments.iter().zip(&action.variables) {
        let Some(number) = problem.objects.find(argument) else {
            let nearest = problem.objects.nearest(argument).map(str::to_owned);
            let (action, object) = (action.name().to_owned(), argument.clone());
            return Err(Stop::failure(Failure::UnknownObject { step: index, action, object, nearest }));
        };
        let types = &domain.vocabulary.types;
        if let Some(object) = problem.objects.get(number)
            && !types.fits(&object.kind, &variable.kind)
        {
            return Err(Stop::failure(Failure::ArgumentType {
                step: index,
                action: action.name().to_owned(),
                parameter: variable.name.as_str().trim_start_matches('?').to_owned(),
                object: object.name.as_str().to_owned(),
                is: types.kind_text(&object.kind),
                wanted: types.kind_text(&variable.kind),
            }));
        }
        objects.push(number);
    }
    Ok((action, objects))
}

fn text(problem: &Problem, action: &Action, objects: &[u32]) -> String {
    let mut text = format!("({}", action.name());
    for object in objects {
        text.push(' ');
        text.push_str(problem.objects.get(*object).map_or("?", |object| object.name.as_str()));
    }
    text.push(')');
    text
}
