//! Actions and derived predicates as rules: facts to look up, the rest of the condition, and what follows.

use crate::pddl::domain::Domain;
use crate::pddl::model::{Arg, Change, Fact, Formula, Number, Variable};

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
    /// What an action does.
    Effect(&'a Change),
    /// A derived predicate of the rule's variables.
    Derived(Fact),
}

impl<'a> Rule<'a> {
    /// The rules of a domain.
    pub(super) fn all(domain: &'a Domain) -> Vec<Self> {
        let actions = domain.actions().iter().map(|action| {
            let (facts, rest) = parts(&action.body.condition);
            let makes = Makes::Effect(&action.body.effect);
            Self { action: Some(action.name()), variables: &action.variables, facts, rest, makes }
        });
        let derived = domain.rules.iter().map(|rule| {
            let (facts, rest) = parts(&rule.condition);
            let arguments = (0_u32..).take(rule.variables.len()).map(Arg::Slot).collect();
            let makes = Makes::Derived(Fact { predicate: rule.predicate, arguments });
            Self { action: None, variables: &rule.variables, facts, rest, makes }
        });
        actions.chain(derived).collect()
    }
}

/// What has to hold, moments aside: the facts among it, and the rest. Preferences need not hold.
pub(super) fn parts(condition: &Formula) -> (Vec<&Fact>, Vec<&Formula>) {
    let (mut facts, mut rest, mut todo) = (Vec::new(), Vec::new(), vec![condition]);
    while let Some(formula) = todo.pop() {
        match formula {
            Formula::And(parts) => todo.extend(parts.iter().rev()),
            Formula::Timed(_, inner) => todo.push(inner),
            Formula::Preference(_) | Formula::Modal => {}
            Formula::Fact(fact) if !fact.arguments.contains(&Arg::Fluent) => facts.push(fact),
            other => rest.push(other),
        }
    }
    (facts, rest)
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
