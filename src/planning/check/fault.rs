//! What is wrong with the rest of a plan, and which part of the memory is the reason.

use bson::Bson;

use crate::pddl::{Failure, Repair, Step};
use crate::planning::PlanningTask;
use crate::problem::{Explanation, Part, Writer, names};
use crate::store::Namespace;

/// What is wrong with the rest of a plan, in the memory's names.
#[derive(Debug, Default)]
pub struct Fault {
    /// The first broken step, counted from 1 over the whole plan; none where the goal is missed.
    pub step: Option<usize>,
    /// The broken step's action, as PDDL.
    pub action: Option<String>,
    /// What is wrong.
    pub message: String,
    /// The conditions that are false, as PDDL.
    pub missing: Vec<String>,
    /// Where missing facts would come from, and where facts come from that should not hold.
    pub origins: Vec<Origin>,
    /// What would make the plan valid again.
    pub repairs: Vec<Repair>,
}

/// Where a fact of the problem comes from, or would come from.
#[derive(Debug)]
pub struct Origin {
    /// The message about it.
    pub what: String,
    /// The place in the template.
    pub template: String,
    /// The document that says it.
    pub document: Option<(Namespace, Bson)>,
    /// Of a fact that is missing, what it depends on that the template writes it: a query and conditions.
    pub reasons: Vec<String>,
}

impl Fault {
    /// Of a failure of `steps`, which are those of the whole plan at the places `left`.
    pub(super) fn new(failure: &Failure, left: &[usize], steps: &[Step], task: &PlanningTask) -> Self {
        let step = failure.step();
        let message = failure.reason();
        let missing = match failure {
            Failure::Precondition { condition, .. } | Failure::Duration { condition, .. } => vec![condition.clone()],
            Failure::Goal { conditions } => conditions.clone(),
            _ => Vec::new(),
        };
        Self {
            step: step.and_then(|step| left.get(step)).map(|index| index + 1),
            action: step.and_then(|step| steps.get(step)).map(readable),
            message: names::readable(&message),
            origins: missing.iter().flat_map(|condition| origins(condition, task)).collect(),
            missing: missing.iter().map(|condition| names::readable(condition)).collect(),
            repairs: Vec::new(),
        }
    }
}

impl Fault {
    /// Of a step that failed; steps count from 1.
    pub(super) fn failed(step: usize) -> Self {
        let message = "it failed and was not started again".to_owned();
        Self { step: Some(step), message, ..Self::default() }
    }
}

/// A step as PDDL, in the memory's names.
fn readable(step: &Step) -> String {
    let words: Vec<&str> = std::iter::once(&step.action).chain(&step.arguments).map(String::as_str).collect();
    names::readable(&format!("({})", words.join(" ")))
}

/// Where the template would write a missing fact, or which document says what should not hold.
fn origins(condition: &str, task: &PlanningTask) -> Vec<Origin> {
    let Some(generated) = &task.generated else { return Vec::new() };
    if is_comparison(condition) {
        // What it compares is in the problem with other numbers; nothing is left out by the template.
        let found = fluents(condition).into_iter();
        let found = found.flat_map(|fluent| generated.explain_atom(task.problem.tree(), fluent));
        let found = found.filter(|found| found.part == Part::Init);
        return found
            .map(|mut found| {
                // The last document is that of the number.
                found.documents.reverse();
                written(found, "")
            })
            .collect();
    }
    let negated = condition.strip_prefix("(not ").and_then(|rest| rest.strip_suffix(')'));
    let atom = negated.unwrap_or(condition);
    let found = generated.explain_atom(task.problem.tree(), atom);
    let found: Vec<Explanation> = found.into_iter().filter(|found| found.part == Part::Init).collect();
    if negated.is_none() && found.is_empty() {
        let predicate = atom.trim_start_matches('(').split([' ', ')']).next().unwrap_or_default();
        let writers = generated.writers(predicate).into_iter();
        return writers.map(|writer| unwritten(&writer)).collect();
    }
    let reason = if negated.is_some() { "" } else { ", but no longer true after the steps before" };
    found.into_iter().map(|found| written(found, reason)).collect()
}

/// Whether a condition compares numbers or objects, like `(>= (fuel r1) 3)`.
fn is_comparison(condition: &str) -> bool {
    let inner = condition.strip_prefix("(not ").unwrap_or(condition).trim_start_matches('(');
    inner.split(char::is_whitespace).next().is_some_and(|head| ["=", "<", ">", "<=", ">="].contains(&head))
}

/// The functions that a comparison looks at, like `(fuel r1)`, each once.
fn fluents(condition: &str) -> Vec<&str> {
    let mut found: Vec<&str> = Vec::new();
    for (start, _) in condition.match_indices('(') {
        let Some(inner) = condition.get(start + 1..) else { continue };
        let Some(end) = inner.find(['(', ')']).filter(|end| inner[*end..].starts_with(')')) else { continue };
        let fluent = &condition[start..start + end + 2];
        let head = inner.split([' ', ')']).next().unwrap_or_default();
        if head.starts_with(|c: char| c.is_ascii_alphabetic()) && !found.contains(&fluent) {
            found.push(fluent);
        }
    }
    found
}

/// The line of the template that would write a fact, and what that line depends on.
fn unwritten(writer: &Writer<'_>) -> Origin {
    Origin {
        what: format!("not in the problem; it would be written by {}", writer.text),
        template: format!("{}:{}", writer.name, writer.line),
        document: None,
        reasons: writer.reasons(),
    }
}

/// The place of the template that wrote a fact, and the document it is from.
fn written(found: Explanation, reason: &str) -> Origin {
    Origin {
        what: format!("{} is in the memory{reason}", names::readable(&found.text)),
        template: format!("{}:{}:{}", found.origin.name, found.origin.line, found.origin.column),
        document: found.documents.into_iter().next(),
        reasons: Vec::new(),
    }
}
