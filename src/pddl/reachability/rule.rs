//! Actions and derived predicates as rules: facts to look up, the rest of the condition, and what follows.

use crate::formats::pddl::ast::{Comparator, Moment};
use crate::pddl::domain::Domain;
use crate::pddl::model::{Arg, Change, Fact, Formula, Number, Variable};
use crate::pddl::problem::Problem;

/// Something that makes facts true.
pub(super) struct Rule<'a> {
    /// The action's name; none for a derived predicate's rule.
    pub(super) action: Option<&'a str>,
    pub(super) variables: &'a [Variable],
    /// The conditions that are facts: they give the variables their values.
    pub(super) facts: Vec<&'a Fact>,
    /// The other conditions.
    pub(super) rest: Vec<&'a Formula>,
    pub(super) makes: Makes<'a>,
}

/// What follows from a rule.
pub(super) enum Makes<'a> {
    /// What an action does; of a durative action, what it does at one of its moments.
    Effect(&'a Change, Option<Moment>),
    /// A derived predicate of the rule's variables.
    Derived(Fact),
}

impl<'a> Rule<'a> {
    /// The rules of a domain.
    pub(super) fn all(domain: &'a Domain, problem: &Problem, changing: &[u32]) -> Vec<Self> {
        let mut rules = Vec::new();
        for action in domain.actions() {
            // What an action needs later may come true by its own start, so its start is a rule of its own.
            let moments: &[Option<Moment>] = match action.body.duration {
                Some(_) => &[Some(Moment::Start), Some(Moment::End)],
                None => &[None],
            };
            rules.extend(moments.iter().map(|moment| {
                let is_short = |duration| !is_long(duration, problem, changing);
                let is_left_out: fn(&Formula) -> bool = match moment {
                    Some(Moment::Start) => is_later,
                    // Between a start and an end at one moment nothing has to hold.
                    Some(_) if action.body.duration.as_ref().is_some_and(is_short) => is_over_all,
                    _ => |_| false,
                };
                let (facts, mut rest) = parts(&action.body.condition, is_left_out);
                rest.extend(action.body.duration.iter().flat_map(|duration| parts(duration, |_| false).1));
                let makes = Makes::Effect(&action.body.effect, *moment);
                Self { action: Some(action.name()), variables: &action.variables, facts, rest, makes }
            }));
        }
        let derived = domain.rules.iter().map(|rule| {
            let (facts, rest) = parts(&rule.condition, |_| false);
            let arguments = (0_u32..).take(rule.variables.len()).map(Arg::Slot).collect();
            let makes = Makes::Derived(Fact { predicate: rule.predicate, arguments });
            Self { action: None, variables: &rule.variables, facts, rest, makes }
        });
        rules.extend(derived);
        rules
    }
}

/// What has to hold, but for what is left out: the facts among it, and the rest. Preferences need not hold.
fn parts(condition: &Formula, is_left_out: fn(&Formula) -> bool) -> (Vec<&Fact>, Vec<&Formula>) {
    let (mut facts, mut rest, mut todo) = (Vec::new(), Vec::new(), vec![condition]);
    while let Some(formula) = todo.pop() {
        match formula {
            Formula::And(parts) => todo.extend(parts.iter().rev()),
            _ if is_left_out(formula) => {}
            Formula::Timed(_, inner) => todo.push(inner),
            Formula::Preference(..) | Formula::Modal(..) => {}
            Formula::Fact(fact) if !fact.arguments.contains(&Arg::Fluent) => facts.push(fact),
            other => rest.push(other),
        }
    }
    (facts, rest)
}

/// Whether something has to hold after the start.
fn is_later(formula: &Formula) -> bool {
    match formula {
        Formula::Timed(moment, _) => *moment != Moment::Start,
        Formula::And(parts) | Formula::Or(parts) => parts.iter().any(is_later),
        Formula::Imply(left, right) => is_later(left) || is_later(right),
        Formula::Not(inner) | Formula::Forall(_, inner) | Formula::Exists(_, inner) => is_later(inner),
        Formula::Fact(_) | Formula::Same(..) | Formula::Compare(..) | Formula::Preference(..) | Formula::Modal(..) => {
            false
        }
    }
}

/// Whether something has to hold while an action runs.
fn is_over_all(formula: &Formula) -> bool {
    matches!(formula, Formula::Timed(Moment::All, _))
}

/// Whether a duration is more than a moment, whatever the objects: plans may have durations that are a hundredth shorter.
fn is_long(duration: &Formula, problem: &Problem, changing: &[u32]) -> bool {
    const MOMENT: f64 = 0.02;
    match duration {
        Formula::And(parts) => parts.iter().any(|part| is_long(part, problem, changing)),
        Formula::Timed(Moment::Start, inner) => is_long(inner, problem, changing),
        Formula::Compare(Comparator::Equal | Comparator::AtLeast | Comparator::Greater, Number::Duration, least) => {
            match least {
                Number::Constant(value) => *value > MOMENT,
                Number::Fluent(fluent) => {
                    let mut values = problem.start.values.iter();
                    is_constant(least, changing)
                        && values.all(|(key, value)| key.first() != Some(&fluent.function) || *value > MOMENT)
                }
                _ => false,
            }
        }
        _ => false,
    }
}

/// Whether an effect at `at` is none of those at a moment.
pub(super) fn is_of_another(at: Moment, moment: Option<Moment>) -> bool {
    moment.is_some_and(|moment| moment != at)
}

/// The functions that actions change.
pub(super) fn changing(domain: &Domain) -> Vec<u32> {
    let (mut found, mut todo): (Vec<u32>, Vec<&Change>) =
        (Vec::new(), domain.actions().iter().map(|action| &action.body.effect).collect());
    while let Some(change) = todo.pop() {
        match change {
            Change::And(parts) => todo.extend(parts),
            Change::Forall(_, inner) | Change::When(_, inner) | Change::Timed(_, inner) => todo.push(inner),
            Change::Assign(_, fluent, _) if !found.contains(&fluent.function) => found.push(fluent.function),
            Change::Assign(..) | Change::AssignObject | Change::Add(_) | Change::Delete(_) => {}
        }
    }
    found
}

/// Whether a number is the same in every state.
pub(super) fn is_constant(number: &Number, changing: &[u32]) -> bool {
    match number {
        Number::Constant(_) => true,
        Number::Fluent(fluent) => !changing.contains(&fluent.function) && !fluent.arguments.contains(&Arg::Fluent),
        Number::Operation(_, operands) => operands.iter().all(|operand| is_constant(operand, changing)),
        Number::Duration | Number::Elapsed | Number::TotalTime | Number::Violations(_) => false,
    }
}
