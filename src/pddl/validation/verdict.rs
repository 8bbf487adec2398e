//! The verdict on a plan, and its text.

use std::fmt;

use crate::formats::pddl::ast::Comparator;
use crate::pddl::resolve::count;

/// What the simulation of a plan says.
#[derive(Debug, Clone, PartialEq)]
pub enum Validation {
    /// Every action can be taken and the goal holds afterwards.
    Valid {
        /// The metric's value afterwards; without a metric, when a plan with times ends, or else the number of actions.
        /// [`None`] where the metric cannot be computed.
        value: Option<f64>,
    },
    /// The plan is wrong, and where.
    Invalid(Failure),
    /// The plan needs a part of PDDL that is not simulated: neither valid nor invalid is claimed.
    Unchecked(String),
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
        /// What makes it true at the same moment, which is too late.
        at_once: Option<String>,
    },
    /// An action takes another time than its duration allows.
    Duration {
        /// Which step.
        step: usize,
        /// The action with its objects.
        action: String,
        /// How long the plan lets it take.
        duration: f64,
        /// The part of its duration's condition that is false, as PDDL.
        condition: String,
        /// How the duration has to compare, and with which value, where the condition is one comparison.
        wanted: Option<(Comparator, f64)>,
    },
    /// A trajectory constraint is broken.
    Constraint {
        /// The step after which it was; [`None`] in the initial state and at the end of the plan.
        step: Option<usize>,
        /// The constraint, as PDDL.
        constraint: String,
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

/// A number without what computing with it left.
fn rounded(number: f64) -> f64 {
    (number * 1e6).round() / 1e6
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
            | Self::Duration { step, .. }
            | Self::Interference { step, .. } => Some(*step),
            Self::Number { step, .. } | Self::Constraint { step, .. } => *step,
            Self::Goal { .. } => None,
        }
    }

    /// The message without the step.
    #[must_use]
    pub fn reason(&self) -> String {
        struct Reason<'a>(&'a Failure);
        impl fmt::Display for Reason<'_> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.write_reason(f)
            }
        }
        Reason(self).to_string()
    }

    fn write_reason(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
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
                write!(f, "action `{action}` names `{object}`, which is not an object{}", maybe(nearest))
            }
            Self::ArgumentType { action, parameter, object, is, wanted, .. } => {
                write!(f, "`{object}` is of type `{is}`, but `{action}` wants `{wanted}` for `?{parameter}`")
            }
            Self::Time { action, reason, .. } => write!(f, "action `{action}`: {reason}"),
            Self::Precondition { action, condition, at_once, .. } => {
                write!(f, "{action} is not applicable: {condition} is false")?;
                match at_once {
                    Some(by) => write!(
                        f,
                        "; {by} makes it true at this very moment, and what needs it has to start later, if only by 0.001"
                    ),
                    None => Ok(()),
                }
            }
            Self::Duration { action, duration, wanted: Some((comparator, value)), .. } => {
                let must = match comparator {
                    Comparator::Equal => "",
                    Comparator::Less => "less than ",
                    Comparator::AtMost => "at most ",
                    Comparator::Greater => "more than ",
                    Comparator::AtLeast => "at least ",
                };
                write!(f, "the duration of {action} is {}, it must be {must}{}", rounded(*duration), rounded(*value))
            }
            Self::Duration { action, duration, condition, .. } => {
                write!(f, "the duration of {action} is {}, but {condition} is false", rounded(*duration))
            }
            Self::Constraint { constraint, .. } => write!(f, "the constraint {constraint} is not satisfied"),
            Self::Number { step: Some(_), action, reason } => write!(f, "{action} is not applicable: {reason}"),
            Self::Number { reason, .. } => write!(f, "the goal cannot be computed: {reason}"),
            Self::Interference { action, with, .. } => {
                write!(f, "{action} cannot happen at the same time as {with}")
            }
            Self::Goal { conditions } => {
                let verb = if conditions.len() == 1 { "is" } else { "are" };
                write!(f, "the goal is not reached: {} {verb} false", conditions.join(", "))
            }
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(step) = self.step() {
            write!(f, "step {}: ", step + 1)?;
        }
        self.write_reason(f)
    }
}

impl fmt::Display for Validation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Valid { value: Some(value) } => write!(f, "the plan is valid, value {}", rounded(*value)),
            Self::Valid { value: None } => f.write_str("the plan is valid"),
            Self::Invalid(failure) => write!(f, "the plan is invalid: {failure}"),
            Self::Unchecked(reason) => write!(f, "the plan cannot be checked: {reason}"),
        }
    }
}
