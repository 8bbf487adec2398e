//! As facts of CLIPS: `plan` and `plan-action`, or those of executives.

use std::fmt::Write as _;

use super::page::{PrintedPlan, slot, symbol};
use crate::fault::{AtFault, Fault};
use crate::formats::clips::is_symbol;
use crate::plan::report::rounded;

/// What a format has no way to write.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PrintError {
    /// CLIPS ends every text at a NUL.
    #[error("{0:?} has a NUL in it, at which CLIPS would end it")]
    Nul(String),
    /// A line of words ends at a line break, and a shell would take what follows for a step.
    #[error("{0:?} has a line break in it, and the format shell has a line for each step; --format json has any name")]
    LineBreak(String),
}

impl AtFault for PrintError {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

/// For whose deftemplates facts are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FactLayout<'a> {
    /// rmem's own `plan` and `plan-action`.
    Own,
    /// `plan` and `plan-action` of Fawkes' executive, for a goal.
    Fawkes {
        /// The slot `goal-id`.
        goal: &'a str,
    },
    /// `pddl-plan` and `pddl-action` of the executive CX, for an instance of PDDL.
    Cx {
        /// The slot `instance`.
        instance: &'a str,
    },
}

pub(super) fn facts(page: &PrintedPlan<'_>, layout: FactLayout<'_>) -> Result<String, PrintError> {
    match layout {
        FactLayout::Own => own(page),
        FactLayout::Fawkes { goal } => fawkes(page, goal),
        FactLayout::Cx { instance } => cx(page, instance),
    }
}

/// The name of a plan for a slot that takes symbols only: some ids would be numbers.
fn plan_id(page: &PrintedPlan<'_>) -> Result<String, PrintError> {
    spelled(if is_symbol(page.id) { page.id.to_owned() } else { symbol(&format!("plan-{}", page.id)) })
}

/// The arguments of a step, each with a blank in front.
fn arguments(page: &PrintedPlan<'_>, arguments: &[String]) -> Result<String, PrintError> {
    arguments.iter().map(|name| Ok(format!(" {}", spelled(slot(&(page.value)(name)))?))).collect()
}

fn fawkes(page: &PrintedPlan<'_>, goal: &str) -> Result<String, PrintError> {
    let (id, goal) = (plan_id(page)?, spelled(symbol(goal))?);
    let mut text = format!("(plan (id {id}) (goal-id {goal})");
    if let Some(cost) = page.plan.cost.map(rounded) {
        let _ = write!(text, " (cost {cost:?})");
    }
    text.push_str(")\n");
    for (index, step) in page.plan.steps.iter().enumerate() {
        let number = index + 1;
        let record = page.document.get_document(number.to_string()).ok();
        let keys = record.into_iter().flat_map(|record| record.keys());
        let mut keys = keys.filter(|key| *key != "action" && !key.starts_with('_'));
        let mut names = String::new();
        for place in 1..=step.arguments.len() {
            let name = keys.next().map_or_else(|| format!("arg{place}"), Clone::clone);
            let _ = write!(names, " {}", spelled(symbol(&name))?);
        }
        let name = spelled(symbol(&step.action))?;
        let values = arguments(page, &step.arguments)?;
        let _ = write!(text, "(plan-action (id {number}) (plan-id {id}) (goal-id {goal}) (action-name {name})");
        let _ = write!(text, " (param-names{names}) (param-values{values})");
        if let Some(start) = step.start {
            let _ = write!(text, " (dispatch-time {start:?})");
        }
        if let Some(duration) = step.duration {
            let _ = write!(text, " (duration {duration:?})");
        }
        let _ = writeln!(text, " (state {}))", page.status(index).symbol());
    }
    Ok(text)
}

fn cx(page: &PrintedPlan<'_>, instance: &str) -> Result<String, PrintError> {
    let (id, instance) = (plan_id(page)?, spelled(symbol(instance))?);
    let mut text = format!("(pddl-plan (id {id}) (instance {instance}))\n");
    for (index, step) in page.plan.steps.iter().enumerate() {
        let name = spelled(symbol(&step.action))?;
        let values = arguments(page, &step.arguments)?;
        let number = index + 1;
        let _ = write!(text, "(pddl-action (instance {instance}) (id {id}-{number}) (plan {id}) (name {name})");
        // Steps without times are in order by it.
        let start = step.start.unwrap_or(index as f64);
        let _ = write!(text, " (params{values}) (planned-start-time {start:?})");
        if let Some(duration) = step.duration {
            let _ = write!(text, " (planned-duration {duration:?})");
        }
        text.push_str(")\n");
    }
    Ok(text)
}

fn own(page: &PrintedPlan<'_>) -> Result<String, PrintError> {
    let id = spelled(symbol(page.id))?;
    let mut text = format!("(plan (id {id})");
    if let Some(cost) = page.plan.cost.map(rounded) {
        let _ = write!(text, " (cost {cost:?})");
    }
    text.push_str(")\n");
    for (index, step) in page.plan.steps.iter().enumerate() {
        let arguments = arguments(page, &step.arguments)?;
        let number = index + 1;
        let name = spelled(symbol(&step.action))?;
        let _ = write!(text, "(plan-action (id {number}) (plan-id {id}) (name {name}) (arguments{arguments})");
        if let Some(start) = step.start {
            let _ = write!(text, " (start {start:?})");
        }
        if let Some(duration) = step.duration {
            let _ = write!(text, " (duration {duration:?})");
        }
        let _ = writeln!(text, " (status {}))", page.status(index).symbol());
    }
    Ok(text)
}

/// A word of a fact that CLIPS reads as a whole.
fn spelled(word: String) -> Result<String, PrintError> {
    if word.contains('\0') { Err(PrintError::Nul(word)) } else { Ok(word) }
}
