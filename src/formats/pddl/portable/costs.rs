//! A task without the costs of its actions, for planners that know no numbers.

use crate::formats::pddl::ast::{Domain, Effect, EffectKind, Init, Name, Problem};

/// Requirements that announce numbers.
const NUMBERS: [&str; 3] = [":action-costs", ":fluents", ":numeric-fluents"];

/// The domain without functions and what changes them. Where conditions look at functions, it is another task.
pub(super) fn domain(domain: &Domain) -> Domain {
    let mut domain = domain.clone();
    domain.functions.clear();
    domain.requirements = requirements(&domain.requirements);
    for action in &mut domain.actions {
        action.effect = action.effect.as_ref().and_then(effect);
    }
    domain
}

/// The problem without the values of functions and the metric.
pub(super) fn problem(problem: &Problem) -> Problem {
    let mut problem = problem.clone();
    problem.init.retain(|fact| !matches!(fact, Init::Value(..)));
    problem.metric = None;
    problem.requirements = requirements(&problem.requirements);
    problem
}

fn requirements(requirements: &[Name]) -> Vec<Name> {
    let is_number = |name: &Name| NUMBERS.iter().any(|number| number.eq_ignore_ascii_case(name.as_str()));
    requirements.iter().filter(|name| !is_number(name)).cloned().collect()
}

/// The effect without changes of functions; none where it is nothing else.
fn effect(whole: &Effect) -> Option<Effect> {
    let place = whole.place;
    let kind = match &whole.kind {
        EffectKind::Assign(..) => return None,
        EffectKind::And(parts) => EffectKind::And(parts.iter().filter_map(effect).collect()),
        EffectKind::Forall(variables, inner) => EffectKind::Forall(variables.clone(), Box::new(effect(inner)?)),
        EffectKind::When(condition, inner) => EffectKind::When(condition.clone(), Box::new(effect(inner)?)),
        EffectKind::Timed(moment, inner) => EffectKind::Timed(*moment, Box::new(effect(inner)?)),
        other => other.clone(),
    };
    Some(Effect { kind, place })
}
