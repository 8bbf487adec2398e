//! Plans as documents, in two layouts.
//!
//! | | numbered | fawkes |
//! |---|---|---|
//! | a plan | `{plan: "success", "1": {action: "unstack", x: "B", y: "A"}, …}` | `{plan: 1, actions: [{name: "unstack", args: ["B", "A"]}, …]}` |
//! | the goal holds already | `{plan: "success"}` | `{plan: 1, actions: []}` |
//! | no plan | `{plan: "fail", outcome: "unsolvable"}` | `{plan: 0}` |
//!
//! The keys of a numbered step are the domain's parameter names without `?`, in the
//! order of the parameters. A key that a step has already (a parameter named `action`,
//! or two parameters of one name) gets the first number that makes it new: `action_2`.
//! An argument for which the domain names no parameter is `arg1`, `arg2`, … by its
//! place. Times of temporal plans are `_start` and `_duration` in a numbered step, which
//! no PDDL name can be, and `start` and `duration` in the other layout. Whoever executes
//! the plan notes its [`Progress`](super::Progress) in the same way.

use bson::{Array, Bson, Document, doc};

use crate::fault::{AtFault, Fault};
use crate::formats::pddl::ast::Domain;
use crate::pddl::{Plan, Step};

/// How a plan is laid out in a document.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Layout {
    /// Numbered steps with the domain's parameter names.
    #[default]
    Numbered,
    /// A list of actions, as Fawkes' planner interfaces wrote it.
    Fawkes,
}

/// What is wrong with a stored plan.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PlanDocumentError {
    /// There is no `plan`, or it says neither yes nor no.
    #[error("`plan` is neither \"success\" (or 1) nor \"fail\" (or 0)")]
    NotAPlan,
    /// A step or an action is not a document.
    #[error("`{0}` is not a document")]
    NotAStep(String),
    /// A step has no action.
    #[error("`{0}` does not name an action")]
    NoAction(String),
    /// The numbers of the steps leave one out.
    #[error("step {0} is missing")]
    Gap(u64),
    /// An argument is not a value that a name could have come from.
    #[error("`{0}` is not a value that a name stands for")]
    NotAName(String),
}

impl AtFault for PlanDocumentError {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

/// A stored plan, read back.
#[derive(Debug, Clone, PartialEq)]
pub enum Stored {
    /// A plan.
    Plan(Plan),
    /// The outcome of a run that found none, where it says so.
    Failure(Option<String>),
}

/// The document of a plan, without `_id` and metadata. `value` gives the memory's value
/// for a name of the problem.
#[must_use]
pub fn to_document(plan: &Plan, domain: &Domain, layout: Layout, value: &dyn Fn(&str) -> Bson) -> Document {
    match layout {
        Layout::Numbered => numbered(plan, domain, value),
        Layout::Fawkes => fawkes(plan, value),
    }
}

/// The document of a run without a plan; `outcome` is [`crate::planner::Outcome::word`].
#[must_use]
pub fn failure(outcome: &str, layout: Layout) -> Document {
    match layout {
        Layout::Numbered => doc! { "plan": "fail", "outcome": outcome },
        Layout::Fawkes => doc! { "plan": 0 },
    }
}

fn numbered(plan: &Plan, domain: &Domain, value: &dyn Fn(&str) -> Bson) -> Document {
    let mut document = doc! { "plan": "success" };
    for (index, step) in plan.steps.iter().enumerate() {
        let mut entry = doc! { "action": &step.action };
        name_arguments(&mut entry, &parameters(domain, &step.action), step.arguments.iter().map(|name| value(name)));
        times(&mut entry, step, ["_start", "_duration"]);
        document.insert((index + 1).to_string(), entry);
    }
    document
}

/// Adds the arguments of a step by the names of its action's parameters; by `arg1`, … where those are not known.
pub(super) fn name_arguments(entry: &mut Document, parameters: &[String], values: impl Iterator<Item = Bson>) {
    for (place, value) in values.enumerate() {
        let key = parameters.get(place).cloned().unwrap_or_else(|| format!("arg{}", place + 1));
        entry.insert(unused(entry, key), value);
    }
}

fn fawkes(plan: &Plan, value: &dyn Fn(&str) -> Bson) -> Document {
    let action = |step: &Step| {
        let arguments: Array = step.arguments.iter().map(|argument| value(argument)).collect();
        let mut entry = doc! { "name": &step.action, "args": arguments };
        times(&mut entry, step, ["start", "duration"]);
        Bson::Document(entry)
    };
    doc! { "plan": 1, "actions": plan.steps.iter().map(action).collect::<Array>() }
}

/// The names of an action's parameters, as keys of a document.
pub(super) fn parameters(domain: &Domain, action: &str) -> Vec<String> {
    let plain = domain.actions.iter().find(|known| known.name.is(action)).map(|known| &known.parameters);
    let durative = || domain.durative_actions.iter().find(|known| known.name.is(action)).map(|known| &known.parameters);
    let names = plain.or_else(durative).into_iter().flatten().map(|parameter| parameter.name.as_str());
    names.map(|name| name.trim_start_matches('?').replace(['.', '$'], "_")).collect()
}

/// `key`, or `key_2`, …: the first that the step has not got yet.
fn unused(entry: &Document, key: String) -> String {
    match entry.contains_key(&key) {
        false => key,
        true => (2_u64..).map(|number| format!("{key}_{number}")).find(|key| !entry.contains_key(key)).unwrap_or(key),
    }
}

fn times(entry: &mut Document, step: &Step, [start, duration]: [&str; 2]) {
    if let Some(time) = step.start {
        entry.insert(start, time);
    }
    if let Some(time) = step.duration {
        entry.insert(duration, time);
    }
}

/// Reads a stored plan of either layout. `name` gives the problem's name for a value of
/// the memory's, and nothing where no name stands for it.
///
/// # Errors
///
/// What is not a plan, naming the key.
pub fn from_document(document: &Document, name: &dyn Fn(&Bson) -> Option<String>) -> Result<Stored, PlanDocumentError> {
    let succeeded = match document.get("plan") {
        Some(Bson::String(word)) if word == "success" => true,
        Some(Bson::String(word)) if word == "fail" => false,
        Some(value) => integer(value).filter(|number| [0, 1].contains(number)).ok_or(PlanDocumentError::NotAPlan)? == 1,
        None => return Err(PlanDocumentError::NotAPlan),
    };
    if !succeeded {
        return Ok(Stored::Failure(document.get_str("outcome").ok().map(str::to_owned)));
    }
    let steps: Result<Vec<Step>, _> = match document.get_array("actions") {
        Ok(actions) => actions.iter().enumerate().map(|(index, action)| listed(index, action, name)).collect(),
        Err(_) => entries(document)?.into_iter().map(|(key, entry)| step(&key, entry, name)).collect(),
    };
    Ok(Stored::Plan(Plan { steps: steps?, cost: cost(document) }))
}

/// The numbered steps in order.
fn entries(document: &Document) -> Result<Vec<(String, &Bson)>, PlanDocumentError> {
    let numbered = document.iter().filter_map(|(key, entry)| Some((key.parse::<u64>().ok()?, key, entry)));
    let mut numbered: Vec<_> = numbered.collect();
    numbered.sort_by_key(|(number, ..)| *number);
    for (expected, (number, ..)) in (1..).zip(&numbered) {
        if expected != *number {
            return Err(PlanDocumentError::Gap(expected));
        }
    }
    Ok(numbered.into_iter().map(|(_, key, entry)| (key.clone(), entry)).collect())
}

fn step(key: &str, entry: &Bson, name: &dyn Fn(&Bson) -> Option<String>) -> Result<Step, PlanDocumentError> {
    let entry = entry.as_document().ok_or_else(|| PlanDocumentError::NotAStep(key.to_owned()))?;
    let action = entry.get_str("action").map_err(|_| PlanDocumentError::NoAction(key.to_owned()))?;
    let arguments = entry.iter().filter(|(key, _)| *key != "action" && !key.starts_with('_'));
    let arguments = arguments
        .map(|(argument, value)| name(value).ok_or_else(|| PlanDocumentError::NotAName(format!("{key}.{argument}"))));
    Ok(Step {
        action: action.to_owned(),
        arguments: arguments.collect::<Result<_, _>>()?,
        start: entry.get("_start").and_then(number),
        duration: entry.get("_duration").and_then(number),
    })
}

fn listed(index: usize, entry: &Bson, name: &dyn Fn(&Bson) -> Option<String>) -> Result<Step, PlanDocumentError> {
    let key = format!("actions.{index}");
    let entry = entry.as_document().ok_or_else(|| PlanDocumentError::NotAStep(key.clone()))?;
    let action = entry.get_str("name").map_err(|_| PlanDocumentError::NoAction(key.clone()))?;
    let arguments = entry.get_array("args").map(Vec::as_slice).unwrap_or_default().iter().enumerate();
    let arguments = arguments
        .map(|(place, value)| name(value).ok_or_else(|| PlanDocumentError::NotAName(format!("{key}.args.{place}"))));
    Ok(Step {
        action: action.to_owned(),
        arguments: arguments.collect::<Result<_, _>>()?,
        start: entry.get("start").and_then(number),
        duration: entry.get("duration").and_then(number),
    })
}

fn cost(document: &Document) -> Option<f64> {
    let lineage = document.get_document("_robmem_info").ok()?.get_document("lineage").ok()?;
    lineage.get("cost").and_then(number)
}

fn number(value: &Bson) -> Option<f64> {
    match value {
        Bson::Double(number) => Some(*number),
        Bson::Int32(number) => Some(f64::from(*number)),
        Bson::Int64(number) => Some(*number as f64),
        _ => None,
    }
}

/// Returns a whole number of a document, of any type: relaxed text, such as that of `rmem query`, does not keep the type.
#[must_use]
pub fn whole(document: &Document, key: &str) -> Option<i64> {
    document.get(key).filter(|value| !matches!(value, Bson::Boolean(_))).and_then(integer)
}

fn integer(value: &Bson) -> Option<i64> {
    match value {
        Bson::Boolean(yes) => Some(i64::from(*yes)),
        value => number(value).filter(|number| number.fract() == 0.0).map(|number| number as i64),
    }
}
