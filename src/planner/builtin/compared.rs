//! Which functions matter to a plan: those that conditions compare, and those that change them.

use std::collections::HashSet;

use ferroplan::types::{Domain, Effect, Expr, Formula, Problem};

/// Returns the functions that conditions of a task compare, with those that the effects on such functions read.
pub(super) fn functions(domain: &Domain, problem: &Problem) -> HashSet<String> {
    let mut found = HashSet::new();
    of_formula(&problem.goal, &mut found);
    domain.derived.iter().for_each(|rule| of_formula(&rule.body, &mut found));
    for action in &domain.actions {
        of_formula(&action.precond, &mut found);
        of_conditions(&action.effect, &mut found);
    }
    let mut count = usize::MAX;
    while found.len() != count {
        count = found.len();
        domain.actions.iter().for_each(|action| of_amounts(&action.effect, &mut found));
    }
    found
}

/// Whether actions change numbers other than the one by which plans are measured, or conditions compare some.
pub(super) fn has_numbers(domain: &Domain, problem: &Problem) -> bool {
    fn changes(effect: &Effect, metric: Option<&String>) -> bool {
        match effect {
            Effect::Num(_, name, ..) => metric != Some(name),
            Effect::And(parts) => parts.iter().any(|part| changes(part, metric)),
            Effect::When(_, inner) | Effect::Forall(_, inner) => changes(inner, metric),
            Effect::Add(..) | Effect::Del(..) => false,
        }
    }
    let metric = match &problem.metric {
        Some((_, Expr::Fluent(name, _))) => Some(name),
        _ => None,
    };
    domain.actions.iter().any(|action| changes(&action.effect, metric)) || !functions(domain, problem).is_empty()
}

/// Adds the functions that a formula compares.
pub(super) fn of_formula(formula: &Formula, found: &mut HashSet<String>) {
    match formula {
        Formula::Comp(_, left, right) => {
            of_expression(left, found);
            of_expression(right, found);
        }
        Formula::Not(inner) | Formula::Forall(_, inner) | Formula::Exists(_, inner) => of_formula(inner, found),
        Formula::And(parts) | Formula::Or(parts) => parts.iter().for_each(|part| of_formula(part, found)),
        _ => {}
    }
}

/// Adds the functions of an expression.
pub(super) fn of_expression(expression: &Expr, found: &mut HashSet<String>) {
    match expression {
        Expr::Num(_) => {}
        Expr::Fluent(name, _) => drop(found.insert(name.clone())),
        Expr::Add(left, right) | Expr::Sub(left, right) | Expr::Mul(left, right) | Expr::Div(left, right) => {
            of_expression(left, found);
            of_expression(right, found);
        }
        Expr::Neg(inner) => of_expression(inner, found),
    }
}

fn of_conditions(effect: &Effect, found: &mut HashSet<String>) {
    match effect {
        Effect::And(parts) => parts.iter().for_each(|part| of_conditions(part, found)),
        Effect::When(condition, inner) => {
            of_formula(condition, found);
            of_conditions(inner, found);
        }
        Effect::Forall(_, inner) => of_conditions(inner, found),
        _ => {}
    }
}

/// Adds what the effects on functions that were found read.
fn of_amounts(effect: &Effect, found: &mut HashSet<String>) {
    match effect {
        Effect::And(parts) => parts.iter().for_each(|part| of_amounts(part, found)),
        Effect::When(_, inner) | Effect::Forall(_, inner) => of_amounts(inner, found),
        Effect::Num(_, name, _, amount) if found.contains(name) => of_expression(amount, found),
        _ => {}
    }
}
