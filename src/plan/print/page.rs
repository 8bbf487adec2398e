//! A plan with what is printed along with it, and the words that several formats share.

use std::fmt::Write as _;

use bson::{Bson, Document};

use crate::formats::clips::{Value, is_symbol, write_value};
use crate::formats::shell;
use crate::pddl::{Plan, Step, Structure};
use crate::plan::Status;
use crate::problem::names;

/// A plan with what is printed along with it.
#[derive(Clone, Copy)]
pub struct PrintedPlan<'a> {
    /// The plan, with the names of the problem.
    pub plan: &'a Plan,
    /// Its document, which is what [`super::Format::Document`] prints.
    pub document: &'a Document,
    /// How far each step is; a step beyond them is open.
    pub statuses: &'a [Status],
    /// The plan's name in facts and graphs.
    pub id: &'a str,
    /// The memory's value for a name of the problem, for those formats that the memory's programs read.
    pub value: &'a dyn Fn(&str) -> Bson,
    /// Which step needs which, where the domain is known.
    pub structure: Option<&'a Structure>,
    /// Whether the problem has a metric, so that the cost is its value and not the number of steps.
    pub has_metric: bool,
    /// Whether actions of the domain take time, so that a plan without steps has a makespan, too.
    pub is_temporal: bool,
    /// The parameter whose values are the lanes of a drawing (default: the one that the most steps have).
    pub lanes: Option<&'a str>,
}

impl PrintedPlan<'_> {
    /// How far a step is; steps count from 0.
    pub(super) fn status(&self, index: usize) -> Status {
        self.statuses.get(index).copied().unwrap_or_default()
    }

    /// When the last step ends, of a plan with times.
    pub(super) fn makespan(&self) -> Option<f64> {
        let none = || (self.is_temporal && self.plan.steps.is_empty()).then_some(0.0);
        self.plan.makespan().or_else(none)
    }

    /// A step with the memory's values, as people read it.
    pub(super) fn readable(&self, step: &Step) -> String {
        let arguments = step.arguments.iter().map(|name| readable(&(self.value)(name))).collect();
        line(&Step { arguments, ..step.clone() })
    }
}

/// A step as it is written in a plan: `(unstack b a)`, or `0.001: (move r1 a b) [5.000]`.
pub(super) fn line(step: &Step) -> String {
    let mut line = step.start.map(|start| format!("{}: ", time(start))).unwrap_or_default();
    let _ = write!(line, "({})", words(step));
    if let Some(duration) = step.duration {
        let _ = write!(line, " [{}]", time(duration));
    }
    line
}

/// The action and its arguments.
pub(super) fn words(step: &Step) -> String {
    std::iter::once(&step.action).chain(&step.arguments).cloned().collect::<Vec<_>>().join(" ")
}

/// Three digits after the point, as temporal planners write, unless that loses something.
pub(super) fn time(time: f64) -> String {
    let short = format!("{time:.3}");
    match short.parse() == Ok(time) {
        true => short,
        false => time.to_string(),
    }
}

/// A value as people read it.
fn readable(value: &Bson) -> String {
    match value {
        Bson::String(text) => names::written(text),
        other => slot(other),
    }
}

/// A value as a program gets it for an argument: a text is itself.
pub(super) fn restored(value: &Bson) -> String {
    match value {
        Bson::String(text) => text.clone(),
        other => shell::relaxed_value(other),
    }
}

/// A value in a slot; what CLIPS has no word for is a string of JSON.
pub(super) fn slot(value: &Bson) -> String {
    let value = match value {
        Bson::String(text) => return symbol(text),
        Bson::Boolean(flag) => Value::Symbol(if *flag { "TRUE" } else { "FALSE" }.to_owned()),
        Bson::Int32(number) => Value::Integer(i64::from(*number)),
        Bson::Int64(number) => Value::Integer(*number),
        Bson::Double(number) if number.is_finite() => Value::Float(*number),
        Bson::ObjectId(id) => Value::Text(id.to_hex()),
        other => Value::Text(serde_json::to_string(other).unwrap_or_default()),
    };
    written(&value)
}

/// A symbol where the text reads back as one, else a string.
pub(super) fn symbol(text: &str) -> String {
    let lexeme = if is_symbol(text) { Value::Symbol } else { Value::Text };
    written(&lexeme(text.to_owned()))
}

fn written(value: &Value) -> String {
    let mut text = String::new();
    write_value(value, &mut text);
    text
}
