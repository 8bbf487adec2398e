//! A plan with what is printed along with it, and the words that several formats share.

use std::fmt::Write as _;

use bson::{Bson, Document};

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
    /// The parameter whose values are the lanes of a drawing (default: the one that the most steps have).
    pub lanes: Option<&'a str>,
}

impl PrintedPlan<'_> {
    /// How far a step is; steps count from 0.
    pub(super) fn status(&self, index: usize) -> Status {
        self.statuses.get(index).copied().unwrap_or_default()
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

/// A value in a slot; what CLIPS has no word for is a string of JSON.
pub(super) fn slot(value: &Bson) -> String {
    match value {
        Bson::String(text) => symbol(text),
        Bson::Boolean(true) => "TRUE".to_owned(),
        Bson::Boolean(false) => "FALSE".to_owned(),
        Bson::Int32(number) => number.to_string(),
        Bson::Int64(number) => number.to_string(),
        Bson::Double(number) if number.is_finite() => format!("{number:?}"),
        Bson::ObjectId(id) => quoted(&id.to_hex()),
        other => quoted(&serde_json::to_string(other).unwrap_or_default()),
    }
}

/// A symbol where the text reads back as one, else a string.
pub(super) fn symbol(text: &str) -> String {
    let delimiters = |c: char| c.is_whitespace() || c.is_control() || "\"()&|<~;".contains(c);
    let variable = text.starts_with('?') || text.starts_with("$?");
    // What starts like a number and ends like one reads as a number; `1a` does not.
    let number = text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) && text.parse::<f64>().is_ok();
    match text.is_empty() || variable || number || text.contains(delimiters) {
        true => quoted(text),
        false => text.to_owned(),
    }
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}
