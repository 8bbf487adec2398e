//! The verdict on a plan.

use std::fmt;

use super::happening::{Instance, Stop, simulate};
use super::state::{Bindings, Trouble, World};
use crate::pddl::Step;
use crate::pddl::domain::{Action, Domain};
use crate::pddl::feature::Feature;
use crate::pddl::problem::Problem;
use crate::pddl::resolve::count;

/// How many false conditions of a goal are listed.
const GOAL_LIMIT: usize = 20;

/// What the simulation of a plan says.
#[derive(Debug, Clone, PartialEq)]
pub enum Validation {
    /// Every action can be taken and the goal holds afterwards.
    Valid {
        /// The metric's value afterwards; without a metric, the number of actions. [`None`]
        /// where the metric counts what is not simulated, such as preferences.
        value: Option<f64>,
    },
    /// The plan is wrong, and where.
    Invalid(Failure),
    /// The plan needs a part of PDDL that is not simulated: neither valid nor invalid is claimed.
    Unjudged(String),
}

/// What is wrong with a plan. Steps count from 0; names are spelled as the domain and the problem spell them.
#[derive(Debug, Clone, PartialEq)]
pub enum Failure {
    /// The domain has no such action.
    UnknownAction {
        /// Which step.
        step: usize,
        /// The name in the plan.
        action: String,
        /// A name of the domain that is like it.
        nearest: Option<String>,
    },
    /// The wrong number of arguments.
    Arity {
        /// Which step.
        step: usize,
        /// The action.
        action: String,
        /// How many it takes.
        wanted: usize,
        /// How many the plan gives.
        found: usize,
    },
    /// The problem has no such object.
    UnknownObject {
        /// Which step.
        step: usize,
        /// The action.
        action: String,
        /// The name in the plan.
        object: String,
        /// A name of the problem that is like it.
        nearest: Option<String>,
    },
    /// An object of the wrong type.
    ArgumentType {
        /// Which step.
        step: usize,
        /// The action.
        action: String,
        /// The parameter, without its `?`.
        parameter: String,
        /// The object.
        object: String,
        /// Its type.
        is: String,
        /// The parameter's type.
        wanted: String,
    },
    /// Times that make no plan: a durative action without them, or only some steps with them.
    Time {
        /// Which step.
        step: usize,
        /// The action.
        action: String,
        /// What is wrong.
        reason: &'static str,
    },
    /// A condition of an action is false when the action needs it.
    Precondition {
        /// Which step.
        step: usize,
        /// The action with its objects, as `(pick r1 ball)`.
        action: String,
        /// The smallest part that is false, as PDDL.
        condition: String,
    },
    /// A number that is not there, or an impossible computation.
    Number {
        /// Which step; [`None`] in the goal.
        step: Option<usize>,
        /// The action with its objects.
        action: String,
        /// What is wrong.
        reason: String,
    },
    /// Two things happen at once that may not.
    Interference {
        /// Which step.
        step: usize,
        /// The action with its objects.
        action: String,
        /// The other one.
        with: String,
    },
    /// Every action can be taken, but the goal does not hold.
    Goal {
        /// Conditions that are false, as PDDL; not all of very many.
        conditions: Vec<String>,
    },
}

impl Validation {
    /// Whether the plan is known to be right.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        matches!(self, Self::Valid { .. })
    }
}

impl Failure {
    /// The first step that is wrong, counted from 0; [`None`] where the goal is.
    #[must_use]
    pub fn step(&self) -> Option<usize> {
        match self {
            Self::UnknownAction { step, .. }
            | Self::Arity { step, .. }
            | Self::UnknownObject { step, .. }
            | Self::ArgumentType { step, .. }
            | Self::Time { step, .. }
            | Self::Precondition { step, .. }
            | Self::Interference { step, .. } => Some(*step),
            Self::Number { step, .. } => *step,
            Self::Goal { .. } => None,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(step) = self.step() {
            write!(f, "step {}: ", step + 1)?;
        }
        let maybe = |nearest: &Option<String>| {
            nearest.as_ref().map_or_else(String::new, |nearest| format!("; did you mean `{nearest}`?"))
        };
        match self {
            Self::UnknownAction { action, nearest, .. } => {
                write!(f, "the domain has no action `{action}`{}", maybe(nearest))
            }
            Self::Arity { action, wanted, found, .. } => {
                write!(f, "action `{action}` takes {}, found {found}", count(*wanted))
            }
            Self::UnknownObject { action, object, nearest, .. } => {
                write!(f, "action `{action}` names `{object}`, which is no object{}", maybe(nearest))
            }
            Self::ArgumentType { action, parameter, object, is, wanted, .. } => {
                write!(f, "`{object}` is of type `{is}`, but `{action}` wants `{wanted}` for `?{parameter}`")
            }
            Self::Time { action, reason, .. } => write!(f, "action `{action}`: {reason}"),
            Self::Precondition { action, condition, .. } => {
                write!(f, "{action} cannot be taken: {condition} is false")
            }
            Self::Number { step: Some(_), action, reason } => write!(f, "{action} cannot be taken: {reason}"),
            Self::Number { reason, .. } => write!(f, "the goal cannot be computed: {reason}"),
            Self::Interference { action, with, .. } => {
                write!(f, "{action} cannot happen at the same time as {with}")
            }
            Self::Goal { conditions } => write!(f, "the goal is not reached: {} is false", conditions.join(", ")),
        }
    }
}

impl fmt::Display for Validation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Valid { value: Some(value) } => write!(f, "the plan is valid, value {value}"),
            Self::Valid { value: None } => f.write_str("the plan is valid"),
            Self::Invalid(failure) => write!(f, "the plan is invalid: {failure}"),
            Self::Unjudged(reason) => write!(f, "the plan cannot be judged: {reason}"),
        }
    }
}

/// Simulates a plan and says whether it reaches the goal.
///
/// Names compare without regard to case. Preferences never make a plan invalid.
#[must_use]
pub fn validate(domain: &Domain, problem: &Problem, steps: &[Step]) -> Validation {
    match judge(domain, problem, steps) {
        Ok(value) => Validation::Valid { value },
        Err(Stop::Failure(failure)) => Validation::Invalid(failure),
        Err(Stop::Unjudged(reason)) => Validation::Unjudged(reason),
    }
}

fn judge(domain: &Domain, problem: &Problem, steps: &[Step]) -> Result<Option<f64>, Stop> {
    let instances = instances(domain, problem, steps)?;
    if domain.is_constrained || problem.is_constrained {
        return Err(Stop::Unjudged("constraints are not simulated".to_owned()));
    }
    let fluents = domain.features().iter().chain(problem.features());
    if fluents.into_iter().any(|used| used.feature == Feature::ObjectFluents) {
        return Err(Stop::Unjudged("object fluents are not simulated".to_owned()));
    }
    let mut world = World::new(domain, problem);
    simulate(&mut world, &instances)?;
    check_goal(&world)?;
    Ok(value(&world, steps.len()))
}

fn check_goal(world: &World<'_>) -> Result<(), Stop> {
    let trouble = |trouble| match trouble {
        Trouble::Unjudged(reason) => Stop::Unjudged(reason),
        Trouble::Wrong(reason) => Stop::Failure(Failure::Number { step: None, action: String::new(), reason }),
    };
    if world.is_true(&world.problem.goal, &mut Bindings::new()).map_err(trouble)? {
        return Ok(());
    }
    let conditions = world.faults(&world.problem.goal, GOAL_LIMIT).map_err(trouble)?;
    Err(Stop::Failure(Failure::Goal { conditions }))
}

fn value(world: &World<'_>, steps: usize) -> Option<f64> {
    match &world.problem.metric {
        Some(metric) => world.number(metric, &Bindings::new()).ok(),
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
        let (action, objects) = look_up(domain, problem, index, step).map_err(Stop::Failure)?;
        if domain_has_locals(domain, action) {
            return Err(Stop::Unjudged(format!("the `:vars` of action `{}` are not simulated", action.name())));
        }
        let start = if is_timed { step.start } else { Some(time) };
        let (start, duration) = times(action, start, step.duration, is_timed)
            .map_err(|reason| Stop::Failure(Failure::Time { step: index, action: action.name().to_owned(), reason }))?;
        let text = text(problem, action, &objects);
        instances.push(Instance { action, objects, start, duration, text });
    }
    Ok(instances)
}

fn domain_has_locals(domain: &Domain, action: &Action) -> bool {
    let tree = domain.tree();
    tree.actions.iter().any(|known| known.name.is(action.name()) && !known.locals.is_empty())
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
) -> Result<(&'a Action, Vec<u32>), Failure> {
    let Some(action) = domain.action(&step.action) else {
        let nearest = domain.nearest_action(&step.action).map(str::to_owned);
        return Err(Failure::UnknownAction { step: index, action: step.action.clone(), nearest });
    };
    let (wanted, found) = (action.variables.len(), step.arguments.len());
    if wanted != found {
        return Err(Failure::Arity { step: index, action: action.name().to_owned(), wanted, found });
    }
    let mut objects = Vec::with_capacity(found);
    for (argument, variable) in step.arguments.iter().zip(&action.variables) {
        let Some(number) = problem.objects.find(argument) else {
            let nearest = problem.objects.nearest(argument).map(str::to_owned);
            let (action, object) = (action.name().to_owned(), argument.clone());
            return Err(Failure::UnknownObject { step: index, action, object, nearest });
        };
        let types = &domain.vocabulary.types;
        if let Some(object) = problem.objects.get(number)
            && !types.fits(&object.kind, &variable.kind)
        {
            return Err(Failure::ArgumentType {
                step: index,
                action: action.name().to_owned(),
                parameter: variable.name.as_str().trim_start_matches('?').to_owned(),
                object: object.name.as_str().to_owned(),
                is: types.kind_text(&object.kind),
                wanted: types.kind_text(&variable.kind),
            });
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
