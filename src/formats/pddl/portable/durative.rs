//! Durative actions as lists of what is asked and what happens at each moment, for planners that read no other form.
//!
//! PDDL lets `and`, `forall` and `when` stand around `at start`, `over all` and `at end`. What names no moment is asked at
//! the start and happens at the end.

use crate::formats::pddl::ast::{
    Comparator, Condition, ConditionKind, Domain, DurativeAction, Effect, EffectKind, Expression, Moment, Name, Place,
    Term, Typed,
};

/// The domain with simple durative actions; nothing where they are that already.
pub(super) fn simple(domain: &Domain) -> Option<Domain> {
    if domain.durative_actions.iter().all(is_simple) {
        return None;
    }
    let mut domain = domain.clone();
    for action in &mut domain.durative_actions {
        if let Some(duration) = &mut action.duration {
            let comparisons = comparisons(duration);
            let comparisons = if comparisons.is_empty() { vec![any_duration(duration.place)] } else { comparisons };
            *duration = Condition { kind: ConditionKind::And(comparisons), place: duration.place };
        }
        if let Some(condition) = &mut action.condition {
            let parts = asked(condition).into_iter().map(|(moment, part)| {
                let place = part.place;
                Condition { kind: ConditionKind::Timed(moment, Box::new(part)), place }
            });
            *condition = Condition { kind: ConditionKind::And(parts.collect()), place: condition.place };
        }
        if let Some(effect) = &mut action.effect {
            let parts = happening(effect).into_iter().map(|(moment, part)| {
                let place = part.place;
                Effect { kind: EffectKind::Timed(moment, Box::new(part)), place }
            });
            *effect = Effect { kind: EffectKind::And(parts.collect()), place: effect.place };
        }
    }
    Some(domain)
}

fn is_simple(action: &DurativeAction) -> bool {
    let is_compared = |condition: &Condition| matches!(condition.kind, ConditionKind::Comparison(..));
    let is_asked = |condition: &Condition| matches!(condition.kind, ConditionKind::Timed(..));
    let is_done = |effect: &Effect| matches!(effect.kind, EffectKind::Timed(..));
    let all = |condition: &Condition, is_one: &dyn Fn(&Condition) -> bool| match &condition.kind {
        ConditionKind::And(parts) => parts.iter().all(is_one),
        _ => is_one(condition),
    };
    action.duration.as_ref().is_none_or(|duration| all(duration, &is_compared) && !comparisons(duration).is_empty())
        && action.condition.as_ref().is_none_or(|condition| all(condition, &is_asked))
        && action.effect.as_ref().is_none_or(|effect| match &effect.kind {
            EffectKind::And(parts) => parts.iter().all(is_done),
            _ => is_done(effect),
        })
}

/// What is said of a duration. It is known at the start.
fn comparisons(duration: &Condition) -> Vec<Condition> {
    match &duration.kind {
        ConditionKind::And(parts) => parts.iter().flat_map(comparisons).collect(),
        ConditionKind::Timed(Moment::Start, inner) => comparisons(inner),
        _ => vec![duration.clone()],
    }
}

/// What holds of every duration, where nothing is said of it.
fn any_duration(place: Place) -> Condition {
    let duration = Expression::Term(Term::Variable(Name::new("?duration", place.0)));
    let kind =
        ConditionKind::Comparison(Comparator::AtLeast, Box::new(duration), Box::new(Expression::Number(0.0, place)));
    Condition { kind, place }
}

/// What is asked, one by one, and when.
fn asked(condition: &Condition) -> Vec<(Moment, Condition)> {
    let place = condition.place;
    match &condition.kind {
        ConditionKind::And(parts) => parts.iter().flat_map(asked).collect(),
        ConditionKind::Timed(moment, inner) => vec![(*moment, (**inner).clone())],
        ConditionKind::Forall(variables, inner) => {
            let of_all = |part| ConditionKind::Forall(variables.clone(), Box::new(part));
            asked(inner).into_iter().map(|(moment, part)| (moment, Condition { kind: of_all(part), place })).collect()
        }
        _ => vec![(Moment::Start, condition.clone())],
    }
}

/// What happens, one by one, and when.
fn happening(effect: &Effect) -> Vec<(Moment, Effect)> {
    let place = effect.place;
    let inside = |inner: &Effect, kind: &dyn Fn(Moment, Effect) -> EffectKind| -> Vec<(Moment, Effect)> {
        let parts = happening(inner).into_iter();
        parts.map(|(moment, part)| (moment, Effect { kind: kind(moment, part), place })).collect()
    };
    match &effect.kind {
        EffectKind::And(parts) => parts.iter().flat_map(happening).collect(),
        EffectKind::Timed(moment, inner) => vec![(*moment, (**inner).clone())],
        EffectKind::Forall(variables, inner) => inside(inner, &|_, part| of_all(variables, part)),
        EffectKind::When(condition, inner) => {
            inside(inner, &|moment, part| EffectKind::When(Box::new(without(condition, moment)), Box::new(part)))
        }
        _ => vec![(Moment::End, effect.clone())],
    }
}

fn of_all(variables: &[Typed], part: Effect) -> EffectKind {
    EffectKind::Forall(variables.to_vec(), Box::new(part))
}

/// The condition of an effect without the moment of the effect. Another moment stays.
fn without(condition: &Condition, moment: Moment) -> Condition {
    let kind = match &condition.kind {
        ConditionKind::Timed(at, inner) if *at == moment => return (**inner).clone(),
        ConditionKind::And(parts) => ConditionKind::And(parts.iter().map(|part| without(part, moment)).collect()),
        other => other.clone(),
    };
    Condition { kind, place: condition.place }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;
    use crate::formats::pddl::{Dialect, read_domain};

    fn written(duration: &str, condition: &str, effect: &str) -> Option<String> {
        let domain = format!(
            "(define (domain d) (:requirements :adl :durative-actions) (:predicates (p ?x) (q))
            (:durative-action a :parameters () :duration {duration} :condition {condition} :effect {effect}))"
        );
        let domain = simple(&read_domain(&Source::new("d", domain), Dialect::default()).unwrap())?;
        let text = domain.durative_actions[0].to_string();
        let (_, text) = text.split_once(":duration ").unwrap();
        Some(text.split_whitespace().collect::<Vec<_>>().join(" "))
    }

    #[test]
    fn lists_of_moments_stay() {
        assert_eq!(written("(= ?duration 1)", "(at start (q))", "(and (at start (q)) (at end (not (q))))"), None);
        assert_eq!(written("(and (>= ?duration 1) (<= ?duration 2))", "()", "(at end (q))"), None);
    }

    #[test]
    fn moments_come_to_the_front() {
        let text = written(
            "(at start (= ?duration 1))",
            "(and (and (at start (q))) (forall (?x) (and (over all (p ?x)) (at end (q)))) (q))",
            "(and (and (at start (q))) (forall (?x) (when (at end (q)) (at end (p ?x)))) (not (q)))",
        );
        let expected = "(and (= ?duration 1)) \
            :condition (and (at start (q)) (over all (forall (?x) (p ?x))) (at end (forall (?x) (q))) (at start (q))) \
            :effect (and (at start (q)) (at end (forall (?x) (when (q) (p ?x)))) (at end (not (q)))))";
        assert_eq!(text.as_deref(), Some(expected));
    }
}
