//! A temporal task without its times: starts and ends as actions of their own (snap actions: Long and Fox 2003,
//! "Exploiting a graphplan framework in temporal planning"; Coles, Fox, Halsey, Long and Smith 2009).
//!
//! What happens in a plan with times, one thing after the other, is a plan of the classical task: what happens at one
//! moment does not interfere, and so may have any order. So where the classical task has no plan, neither has the
//! temporal one:
//!
//! - A start asks for what must hold at the start, and an end for what must hold at the end. Between them the action is
//!   entered, which asks for what must hold over all: at some moment between two happenings all of it holds.
//! - Timed initial literals happen in their order, at any time, and before the goal is looked at. Those that are about nothing
//!   in the goal need not: they may follow any plan.
//! - An action that starts while it runs already, with the same objects, may from then on end without having ended.
//! - Preferences and constraints are left out: they only forbid.

use ferroplan::types::{Action, Domain, Duration, DurativeAction, Effect, Expr, Formula, Problem, Term, TimeSpec};

use super::compress::predicates;
use super::happen::happen;

/// Returns the classical task; `None` where its plans would not stand for those of the temporal one.
pub(super) fn snapped(domain: &Domain, problem: &Problem) -> Option<(Domain, Problem)> {
    // What is derived may be read while something else changes it.
    if !domain.derived.is_empty() {
        return None;
    }
    let (mut flat, mut instance) = (domain.clone(), problem.clone());
    for action in flat.durative_actions.drain(..).collect::<Vec<_>>() {
        // Names of tasks have no blanks.
        let names = ["RUNNING", "ENTERED", "REPEATED"].map(|what| format!("{what} {}", action.name));
        let kinds: Vec<String> = action.params.iter().map(|(_, kind)| kind.clone()).collect();
        flat.predicates.extend(names.clone().map(|name| (name, kinds.clone())));
        flat.actions.extend(parts(&action, &names, (domain, problem)));
    }
    let mut wanted = Vec::new();
    predicates(&problem.goal, &mut |name| wanted.push(name));
    happen(&mut flat, &mut instance, |time| time, |literal| wanted.contains(&literal.pred.as_str()));
    (flat.constraints, instance.constraints, instance.metric) = (Vec::new(), Vec::new(), None);
    Some((flat, instance))
}

fn plain(name: &str, params: Vec<(String, String)>, conditions: Vec<Formula>, effects: Vec<Effect>) -> Action {
    let (precond, effect) = (Formula::And(conditions), Effect::And(effects));
    Action { name: name.to_owned(), params, precond, effect, monitored: false }
}

/// The start of an action, its way to its end, its end, its start while it runs, and its end where it goes on.
fn parts(
    action: &DurativeAction,
    [running, entered, repeated]: &[String; 3],
    (domain, problem): (&Domain, &Problem),
) -> Vec<Action> {
    let terms: Vec<Term> = action.params.iter().map(|(name, _)| Term::Var(name.clone())).collect();
    let holds = |name: &String| Formula::Atom(name.clone(), terms.clone());
    let add = |name: &String| Effect::Add(name.clone(), terms.clone());
    let delete = |name: &String| Effect::Del(name.clone(), terms.clone());
    let conditions = |time: TimeSpec, first: &[&String]| -> Vec<Formula> {
        let own = action.conditions.iter().filter(|(at, _)| *at == time).map(|(_, condition)| condition.clone());
        first.iter().map(|name| holds(name)).chain(own).collect()
    };
    let effects = |time: TimeSpec, last: Vec<Effect>| -> Vec<Effect> {
        let own = action.effects.iter().filter(|(at, _)| *at == time).map(|(_, effect)| effect.clone());
        own.chain(last).collect()
    };
    let part = |what: &str, conditions, effects| {
        plain(&format!("{what} {}", action.name), action.params.clone(), conditions, effects)
    };
    // Between a start and an end at one moment nothing has to hold.
    let over_all = match is_long(&action.duration, domain, problem) {
        true => conditions(TimeSpec::All, &[running]),
        false => vec![holds(running)],
    };
    vec![
        part("START", conditions(TimeSpec::Start, &[]), effects(TimeSpec::Start, vec![add(running)])),
        part("ENTER", over_all, vec![add(entered)]),
        part(
            "END",
            conditions(TimeSpec::End, &[running, entered]),
            effects(TimeSpec::End, vec![delete(running), delete(entered)]),
        ),
        part("REPEAT", conditions(TimeSpec::Start, &[running]), effects(TimeSpec::Start, vec![add(repeated)])),
        part("GO ON", conditions(TimeSpec::End, &[running, entered, repeated]), effects(TimeSpec::End, Vec::new())),
    ]
}

/// Whether a duration is more than a moment, whatever the objects: plans may have durations that are a hundredth shorter.
fn is_long(duration: &Duration, domain: &Domain, problem: &Problem) -> bool {
    const MOMENT: f64 = 0.02;
    match &duration.min {
        Some(Expr::Num(number)) => *number > MOMENT,
        Some(Expr::Fluent(name, _)) => {
            let timed =
                domain.durative_actions.iter().flat_map(|action| action.effects.iter().map(|(_, effect)| effect));
            let mut effects = timed.chain(domain.actions.iter().map(|action| &action.effect));
            let mut values = problem.init_fluents.iter().filter(|((function, _), _)| function == name);
            values.all(|(_, value)| *value > MOMENT) && !effects.any(|effect| sets(effect, name))
        }
        _ => false,
    }
}

/// Whether an effect changes the values of a function.
fn sets(effect: &Effect, function: &str) -> bool {
    match effect {
        Effect::Num(_, name, ..) => name == function,
        Effect::And(inner) => inner.iter().any(|part| sets(part, function)),
        Effect::When(_, inner) | Effect::Forall(_, inner) => sets(inner, function),
        Effect::Add(..) | Effect::Del(..) => false,
    }
}

#[cfg(test)]
mod tests {
    use ferroplan::parser::{parse_domain, parse_problem};

    use super::super::compress::changed;
    use super::*;

    #[test]
    fn the_goal_waits_only_for_literals_that_it_is_about() {
        let domain = "(define (domain d) (:requirements :durative-actions :timed-initial-literals) (:predicates (p) (q) (r))
            (:durative-action a :parameters () :duration (= ?duration 1) :condition (over all (p)) :effect (at end (q))))";
        let awaiting = |goal: &str| {
            let problem =
                format!("(define (problem x) (:domain d) (:init (p) (at 5 (not (p))) (at 9 (r))) (:goal {goal}))");
            let (domain, problem) = (parse_domain(domain).unwrap(), parse_problem(&problem).unwrap());
            let (flat, _) = snapped(&domain, &problem).unwrap();
            let adds = |action: &&Action| changed(&action.effect).contains(&"AWAITED LITERALS");
            flat.actions.iter().find(adds).map(|action| action.name.clone())
        };
        assert_eq!(awaiting("(q)"), None);
        assert_eq!(awaiting("(p)").as_deref(), Some("HAPPEN 0"));
        assert_eq!(awaiting("(and (p) (not (r)))").as_deref(), Some("HAPPEN 1"));
    }
}
