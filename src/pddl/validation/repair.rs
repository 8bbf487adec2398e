//! What would make a plan that breaks go on: where each false fact was lost, and which actions would bring it back.
//!
//! The plan is simulated once more, with a record of what each step did to each fact. In the state in which it breaks,
//! the actions are looked for that have the missing fact as an effect, and of each a choice of objects
//! with which it could be taken right there; the search for that is bounded.

use std::fmt;

use super::error::EvaluationError;
use super::join::Join;
use super::simulation::verify;
use super::state::{Bindings, Ground, History, State, UNBOUND};
use super::truth::at_moment;
use crate::formats::pddl::ast::{Assigner, Comparator, Moment};
use crate::pddl::Step;
use crate::pddl::domain::{Action, Domain};
use crate::pddl::model::{Arg, Change, Fact, Fluent, Formula, Number, Variable};
use crate::pddl::problem::Problem;

/// How many false facts are looked into.
const LACKS: usize = 8;

/// How many actions are named for each.
const REMEDIES: usize = 4;

/// How many conditions that an action lacks are named.
const MISSING: usize = 4;

/// How many facts and objects are tried to find out whether an action can be taken.
const MAX_ATTEMPTS: u64 = 200_000;

/// A part of a false condition, and what would make it true.
#[derive(Debug, Clone, PartialEq)]
pub struct Repair {
    /// What has to become true, as PDDL: a fact, the absence of one, or a comparison.
    pub condition: String,
    /// What made it false.
    pub cause: Cause,
    /// The values that a comparison looks at, as PDDL.
    pub values: Vec<String>,
    /// Actions that would make it true, those first that can be taken; not all of very many.
    pub remedies: Vec<Remedy>,
}

/// What made a condition false.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cause {
    /// It never was true.
    Never,
    /// A step did, counted from 0.
    Step {
        /// Which step.
        step: usize,
        /// The action with its objects.
        action: String,
    },
    /// A timed initial literal.
    Literal,
    /// Rules derive it from other facts.
    Derived,
    /// It is a comparison, or about no object in particular.
    Unknown,
}

/// An action that would make a condition true.
#[derive(Debug, Clone, PartialEq)]
pub struct Remedy {
    /// The action with its objects, and variables where any object would do.
    pub action: String,
    /// Whether it can be taken where the plan breaks.
    pub is_possible: bool,
    /// What it lacks there, as PDDL, where its objects are known.
    pub missing: Vec<String>,
}

/// Says what would repair a plan; nothing for a plan that is right, or whose fault is not a false condition.
#[must_use]
pub fn repair(domain: &Domain, problem: &Problem, steps: &[Step]) -> Vec<Repair> {
    repair_rest(domain, problem, steps, &[])
}

/// Says what would repair the rest of a plan of which some steps are running, as [`super::validate_rest`] simulates it.
#[must_use]
pub fn repair_rest(domain: &Domain, problem: &Problem, steps: &[Step], running: &[usize]) -> Vec<Repair> {
    let mut state = State::new(domain, problem);
    state.history = Some(History::new());
    if verify(&mut state, steps, running).is_ok() {
        return Vec::new();
    }
    state.duration = None;
    let mut lacks = Vec::new();
    let blamed = state.blamed.take();
    for (formula, bindings) in &blamed {
        collect(formula, true, bindings, &mut lacks);
    }
    lacks.truncate(LACKS);
    lacks.iter().filter_map(|lack| Scene { state: &state, steps }.against(lack).ok()).collect()
}

/// What has to change for a condition to hold.
enum Lack<'f> {
    /// A fact has to become true, or false.
    Fact { fact: &'f Fact, bindings: Bindings, wanted: bool },
    /// A comparison has to become true, or false.
    Comparison { formula: &'f Formula, sides: [&'f Number; 2], bindings: Bindings, wanted: bool },
}

/// The facts and comparisons of a condition that would have to change for it to become true, or false.
fn collect<'f>(formula: &'f Formula, wanted: bool, bindings: &Bindings, lacks: &mut Vec<Lack<'f>>) {
    let bindings = bindings.clone();
    match formula {
        Formula::Fact(fact) => lacks.push(Lack::Fact { fact, bindings, wanted }),
        // The plan says how long an action takes, not the state.
        Formula::Compare(_, Number::Duration, Number::Constant(_)) => {}
        Formula::Compare(_, left, right) => {
            lacks.push(Lack::Comparison { formula, sides: [left, right], bindings, wanted });
        }
        Formula::Not(inner) => collect(inner, !wanted, &bindings, lacks),
        Formula::And(parts) | Formula::Or(parts) => {
            parts.iter().for_each(|part| collect(part, wanted, &bindings, lacks));
        }
        Formula::Imply(left, right) => {
            collect(left, !wanted, &bindings, lacks);
            collect(right, wanted, &bindings, lacks);
        }
        Formula::Timed(_, inner) | Formula::Forall(_, inner) | Formula::Exists(_, inner) => {
            collect(inner, wanted, &bindings, lacks);
        }
        Formula::Same(..) | Formula::Preference(..) | Formula::Modal(..) => {}
    }
}

/// An effect on a fact, with what it depends on.
struct Effect<'e> {
    fact: &'e Fact,
    conditions: Vec<&'e Formula>,
    /// The variables of the quantifiers around it, with their slots.
    variables: Vec<(u32, &'e Variable)>,
}

/// The state in which the plan breaks, and the plan.
struct Scene<'s> {
    state: &'s State<'s>,
    steps: &'s [Step],
}

impl<'s> Scene<'s> {
    fn against(&self, lack: &Lack<'_>) -> Result<Repair, EvaluationError> {
        match lack {
            Lack::Fact { fact, bindings, wanted } => self.against_fact(fact, bindings, *wanted),
            Lack::Comparison { formula, sides, bindings, wanted } => {
                let text = self.state.text(formula, bindings);
                let condition = if *wanted { text } else { format!("(not {text})") };
                let mut fluents = Vec::new();
                let up = is_larger(formula).map(|larger| larger == *wanted);
                for (side, up) in sides.iter().zip([up, up.map(|up| !up)]) {
                    mentioned(side, up, &mut fluents);
                }
                let values =
                    fluents.iter().map(|(fluent, _)| self.value(fluent, bindings)).collect::<Result<_, _>>()?;
                let remedies = self.computing(&fluents, bindings);
                Ok(Repair { condition, cause: Cause::Unknown, values, remedies })
            }
        }
    }

    fn against_fact(&self, fact: &Fact, bindings: &Bindings, wanted: bool) -> Result<Repair, EvaluationError> {
        let state = self.state;
        let target = state.ground(fact.predicate, &fact.arguments, bindings)?;
        let text = state.fact_text(&target);
        let condition = if wanted { text } else { format!("(not {text})") };
        let is_derived = state.domain.derived.contains(&fact.predicate);
        let cause = match is_derived {
            true => Cause::Derived,
            false if target.contains(&UNBOUND) => Cause::Unknown,
            false => self.cause(&target, wanted),
        };
        let mut remedies = Vec::new();
        for action in state.domain.actions() {
            let mut effects = Vec::new();
            find_effects(&action.body.effect, wanted, &mut Vec::new(), &mut Vec::new(), &mut effects);
            for effect in effects {
                let Some(objects) = self.unify(action, &effect, &target) else { continue };
                let remedy = self.remedy(action, &effect, objects)?;
                if !remedies.contains(&remedy) {
                    remedies.push(remedy);
                }
            }
        }
        remedies.sort_by_key(|remedy| (!remedy.is_possible, remedy.missing.len()));
        remedies.truncate(REMEDIES);
        Ok(Repair { condition, cause, values: Vec::new(), remedies })
    }

    fn cause(&self, target: &Ground, wanted: bool) -> Cause {
        let history = self.state.history.as_ref().and_then(|history| history.get(target));
        match history {
            Some((Some(step), made)) if *made != wanted => Cause::Step { step: *step, action: self.step_text(*step) },
            Some((None, made)) if *made != wanted => Cause::Literal,
            _ => Cause::Never,
        }
    }

    fn step_text(&self, step: usize) -> String {
        let Some(step) = self.steps.get(step) else { return String::new() };
        let action = self.state.domain.action(&step.action).map_or(step.action.as_str(), Action::name);
        let object = |name: &'s String| self.state.problem.object(name).map_or(name.as_str(), |object| object.name);
        let words = std::iter::once(action).chain(step.arguments.iter().map(object));
        format!("({})", words.collect::<Vec<_>>().join(" "))
    }

    /// The objects that make an effect one on the target.
    fn unify(&self, action: &Action, effect: &Effect<'_>, target: &Ground) -> Option<Bindings> {
        if target.first() != Some(&effect.fact.predicate) {
            return None;
        }
        let slots = effect.variables.iter().map(|(slot, _)| *slot as usize + 1).max().unwrap_or_default();
        let mut objects: Bindings = vec![UNBOUND; slots.max(action.variables.len())];
        for (argument, wanted) in effect.fact.arguments.iter().zip(target.iter().skip(1)) {
            match argument {
                _ if *wanted == UNBOUND => {}
                Arg::Object(number) if number != wanted => return None,
                Arg::Slot(slot) => {
                    let bound = effect.variables.iter().find(|(other, _)| other == slot);
                    let variable = bound.map(|(_, variable)| *variable);
                    let variable = variable.or_else(|| action.variables.get(*slot as usize))?;
                    let value = objects.get_mut(*slot as usize)?;
                    if !self.state.is_member(*wanted, &variable.kind) || (*value != UNBOUND && *value != *wanted) {
                        return None;
                    }
                    *value = *wanted;
                }
                Arg::Object(_) | Arg::Fluent => {}
            }
        }
        Some(objects)
    }

    /// An action with such an effect: with objects with which it can be taken, where some are found.
    fn remedy(&self, action: &Action, effect: &Effect<'_>, objects: Bindings) -> Result<Remedy, EvaluationError> {
        let condition = needed(action, effect);
        if let Some(objects) = self.solution(&condition, action, effect, &objects) {
            let objects = objects.get(..action.variables.len()).unwrap_or_default();
            return Ok(Remedy { action: self.call(action, objects), is_possible: true, missing: Vec::new() });
        }
        let parameters = objects.get(..action.variables.len()).unwrap_or_default();
        let mut missing = Vec::new();
        let Formula::And(parts) = &condition else { return Err(EvaluationError::Unchecked(String::new())) };
        for part in parts {
            // With open variables it may hold for some; only what is certain is reported.
            if missing.len() < MISSING
                && self.is_closed(part, &objects)
                && !self.state.is_true(part, &mut objects.clone())?
            {
                let (part, values) = self.state.faulty(part, &mut objects.clone())?;
                missing.push(self.state.text(part, &values));
            }
        }
        Ok(Remedy { action: self.call(action, parameters), is_possible: false, missing })
    }

    /// Whether the objects of a condition are all known.
    fn is_closed(&self, formula: &Formula, objects: &Bindings) -> bool {
        let mut slots = Vec::new();
        super::free_slots(formula, u32::try_from(objects.len()).unwrap_or(u32::MAX), &mut slots);
        slots.iter().all(|slot| objects.get(*slot as usize).is_some_and(|object| *object != UNBOUND))
    }

    /// Objects with which a condition holds where the plan breaks, if some are found soon.
    fn solution(
        &self,
        condition: &Formula,
        action: &Action,
        effect: &Effect<'_>,
        objects: &Bindings,
    ) -> Option<Bindings> {
        // The slots of those variables are those of the quantifiers in the condition.
        if !effect.variables.is_empty() && is_quantified(condition) {
            return None;
        }
        let mut kinds: Vec<_> = action.variables.iter().map(|variable| variable.kind.clone()).collect();
        for (slot, variable) in &effect.variables {
            kinds.resize(kinds.len().max(*slot as usize + 1), variable.kind.clone());
            if let Some(kind) = kinds.get_mut(*slot as usize) {
                *kind = variable.kind.clone();
            }
        }
        let slots: Vec<u32> = (0_u32..).take(action.variables.len()).collect();
        let index = self.state.index_of(condition).ok()?;
        let join = Join::new(self.state, &index, None, MAX_ATTEMPTS);
        join.first(condition, &slots, &kinds, objects.clone()).ok().flatten()
    }

    /// A call of an action, with the names of its variables for objects that are not known.
    fn call(&self, action: &Action, objects: &[u32]) -> String {
        let words = action.variables.iter().zip(objects).map(|(variable, object)| match *object {
            UNBOUND => variable.name.as_str(),
            object => self.state.object_name(object),
        });
        format!("({})", std::iter::once(action.name()).chain(words).collect::<Vec<_>>().join(" "))
    }

    /// `(fuel t1) is 3`
    fn value(&self, fluent: &Fluent, bindings: &Bindings) -> Result<String, EvaluationError> {
        let ground = self.state.ground(fluent.function, &fluent.arguments, bindings)?;
        let name = self.state.ground_function_text(&ground);
        Ok(match self.state.values.get(&ground) {
            Some(value) => format!("{name} is {value}"),
            None => format!("{name} has no value"),
        })
    }

    /// The actions that change a value in the right direction.
    fn computing(&self, fluents: &[(&Fluent, Option<bool>)], bindings: &Bindings) -> Vec<Remedy> {
        let mut remedies: Vec<Remedy> = Vec::new();
        for (fluent, up) in fluents {
            let Ok(target) = self.state.ground(fluent.function, &fluent.arguments, bindings) else { continue };
            for action in self.state.domain.actions() {
                let mut changed = Vec::new();
                find_assignments(&action.body.effect, &mut changed);
                let is_wrong = |assigner| up.is_some_and(|up| raises(assigner).is_some_and(|raises| raises != up));
                changed.retain(|(assigner, other)| other.function == fluent.function && !is_wrong(*assigner));
                for (_, other) in changed {
                    let fact = Fact { predicate: fluent.function, arguments: other.arguments.clone() };
                    let effect = Effect { fact: &fact, conditions: Vec::new(), variables: Vec::new() };
                    let Some(objects) = self.unify(action, &effect, &target) else { continue };
                    let Ok(remedy) = self.remedy(action, &effect, objects) else { continue };
                    if !remedies.contains(&remedy) {
                        remedies.push(remedy);
                    }
                }
            }
        }
        remedies.sort_by_key(|remedy| (!remedy.is_possible, remedy.missing.len()));
        remedies.truncate(REMEDIES);
        remedies
    }
}

/// All that an action needs to have an effect, as one conjunction.
fn needed(action: &Action, effect: &Effect<'_>) -> Formula {
    let condition = &action.body.condition;
    let mut parts = Vec::new();
    if action.is_durative() {
        parts.extend([Moment::Start, Moment::All].map(|moment| at_moment(condition, moment)));
    } else {
        parts.push(condition.clone());
    }
    parts.extend(effect.conditions.iter().map(|condition| (*condition).clone()));
    let mut flat = Vec::new();
    while let Some(part) = parts.pop() {
        match part {
            Formula::And(inner) => parts.extend(inner),
            Formula::Timed(_, inner) => parts.push(*inner),
            Formula::Preference(..) => {}
            other => flat.push(other),
        }
    }
    flat.reverse();
    Formula::And(flat)
}

/// The effects that make facts true, or false.
fn find_effects<'e>(
    change: &'e Change,
    wanted: bool,
    conditions: &mut Vec<&'e Formula>,
    variables: &mut Vec<(u32, &'e Variable)>,
    found: &mut Vec<Effect<'e>>,
) {
    match change {
        Change::Add(fact) | Change::Delete(fact) if matches!(change, Change::Add(_)) == wanted => {
            found.push(Effect { fact, conditions: conditions.clone(), variables: variables.clone() });
        }
        Change::And(parts) => parts.iter().for_each(|part| find_effects(part, wanted, conditions, variables, found)),
        Change::Timed(_, inner) => find_effects(inner, wanted, conditions, variables, found),
        Change::When(condition, inner) => {
            conditions.push(condition);
            find_effects(inner, wanted, conditions, variables, found);
            conditions.pop();
        }
        Change::Forall(quantifier, inner) => {
            let outer = variables.len();
            variables.extend((quantifier.first..).zip(&quantifier.variables));
            find_effects(inner, wanted, conditions, variables, found);
            variables.truncate(outer);
        }
        _ => {}
    }
}

fn is_quantified(formula: &Formula) -> bool {
    match formula {
        Formula::Forall(..) | Formula::Exists(..) => true,
        Formula::And(parts) | Formula::Or(parts) => parts.iter().any(is_quantified),
        Formula::Imply(left, right) => is_quantified(left) || is_quantified(right),
        Formula::Not(inner) | Formula::Timed(_, inner) => is_quantified(inner),
        _ => false,
    }
}

/// Whether an assignment makes a number larger or smaller, where that is its name.
fn raises(assigner: Assigner) -> Option<bool> {
    match assigner {
        Assigner::Increase | Assigner::ScaleUp => Some(true),
        Assigner::Decrease | Assigner::ScaleDown => Some(false),
        Assigner::Assign => None,
    }
}

/// Whether a comparison asks for a larger left side, or a smaller one.
fn is_larger(formula: &Formula) -> Option<bool> {
    match formula {
        Formula::Compare(Comparator::Greater | Comparator::AtLeast, ..) => Some(true),
        Formula::Compare(Comparator::Less | Comparator::AtMost, ..) => Some(false),
        _ => None,
    }
}

/// The numbers that an effect changes.
fn find_assignments<'e>(change: &'e Change, found: &mut Vec<(Assigner, &'e Fluent)>) {
    match change {
        Change::Assign(assigner, fluent, _) => found.push((*assigner, fluent)),
        Change::And(parts) => parts.iter().for_each(|part| find_assignments(part, found)),
        Change::Timed(_, inner) | Change::When(_, inner) | Change::Forall(_, inner) => find_assignments(inner, found),
        Change::Add(_) | Change::Delete(_) | Change::AssignObject => {}
    }
}

/// The functions in an expression, and whether they should become larger, where they are the whole of it.
fn mentioned<'n>(number: &'n Number, up: Option<bool>, found: &mut Vec<(&'n Fluent, Option<bool>)>) {
    match number {
        Number::Fluent(fluent) => found.push((fluent, up)),
        Number::Operation(_, operands) => operands.iter().for_each(|operand| mentioned(operand, None, found)),
        _ => {}
    }
}

/// What has to become true and why it is not, then a line for each remedy.
impl fmt::Display for Repair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.condition)?;
        match &self.cause {
            Cause::Step { step, action } => write!(f, "undone by step {}, {action}", step + 1)?,
            Cause::Literal => f.write_str("undone by a timed initial literal")?,
            Cause::Never => f.write_str("false in the initial state")?,
            Cause::Derived => f.write_str("follows from other facts by the rules of the domain")?,
            Cause::Unknown if self.values.is_empty() => f.write_str("depends on the object")?,
            Cause::Unknown => f.write_str(&self.values.join(", "))?,
        }
        for Remedy { action, is_possible, missing } in &self.remedies {
            let would = if self.values.is_empty() { "would make it true" } else { "would change that" };
            match (is_possible, missing.as_slice()) {
                (true, _) => write!(f, "\n  {action} {would}, and is applicable there")?,
                (false, []) => write!(f, "\n  {action} {would}, but is not applicable there")?,
                (false, missing) => write!(f, "\n  {action} {would}, but needs {}", missing.join(", "))?,
            }
        }
        match self.remedies.is_empty() && !matches!(self.cause, Cause::Unknown | Cause::Derived) {
            true => f.write_str("\n  no action makes it true; it has to hold in the initial state"),
            false => Ok(()),
        }
    }
}
