//! Plans as text for planners' tools, programs and people.

use std::fmt::Write as _;

use bson::Bson;

use super::{Layout, Plan, to_document};
use crate::formats::pddl::ast::Domain;
use crate::pddl::Step;

/// How a plan is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Format {
    /// As the planning competitions write it: `(unstack b a)`, `; cost = 2 (unit cost)`.
    #[default]
    Text,
    /// The document, as one line of JSON.
    Json,
    /// Facts `plan` and `plan-action`.
    Clips,
    /// As FF writes it: `step    0: unstack b a`.
    Ff,
    /// A graph for Graphviz.
    Dot,
}

/// What a format has no way to write.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PrintError {
    /// CLIPS ends every text at a NUL.
    #[error("{0:?} has a NUL in it, at which CLIPS would end it")]
    Nul(String),
}

/// Prints a plan; the text ends with a line break. `value` gives the memory's value for a
/// name of the problem, for those formats that the memory's programs read; `id` is the
/// plan's name in facts and graphs.
///
/// # Errors
///
/// A value that the format cannot spell.
pub fn print(
    plan: &Plan,
    format: Format,
    domain: &Domain,
    id: &str,
    value: &dyn Fn(&str) -> Bson,
) -> Result<String, PrintError> {
    match format {
        Format::Text => Ok(text(plan)),
        Format::Json => Ok(json(plan, domain, value)),
        Format::Clips => clips(plan, id, value),
        Format::Ff => Ok(ff(plan)),
        Format::Dot => Ok(dot(plan, id, value)),
    }
}

/// `(unstack b a)`, or `0.001: (move r1 a b) [5.000]`.
fn text(plan: &Plan) -> String {
    let mut text: String = plan.steps.iter().map(|step| format!("{}\n", line(step))).collect();
    let length = plan.steps.len() as f64;
    let _ = match plan.cost {
        // The number of steps is what a plan costs where nothing else was asked for, and says
        // nothing about one with times.
        Some(cost) if cost != length => writeln!(text, "; cost = {cost} (general cost)"),
        _ if plan.is_temporal() => Ok(()),
        _ => writeln!(text, "; cost = {length} (unit cost)"),
    };
    text
}

fn line(step: &Step) -> String {
    let mut line = step.start.map(|start| format!("{}: ", time(start))).unwrap_or_default();
    let _ = write!(line, "({})", words(step));
    if let Some(duration) = step.duration {
        let _ = write!(line, " [{}]", time(duration));
    }
    line
}

fn words(step: &Step) -> String {
    std::iter::once(&step.action).chain(&step.arguments).cloned().collect::<Vec<_>>().join(" ")
}

/// Three digits after the point, as temporal planners write, unless that loses something.
fn time(time: f64) -> String {
    let short = format!("{time:.3}");
    match short.parse() == Ok(time) {
        true => short,
        false => time.to_string(),
    }
}

fn json(plan: &Plan, domain: &Domain, value: &dyn Fn(&str) -> Bson) -> String {
    let document = to_document(plan, domain, Layout::Numbered, value);
    // Documents become JSON without fail: their keys are strings.
    format!("{}\n", serde_json::to_string(&document).unwrap_or_default())
}

fn ff(plan: &Plan) -> String {
    let mut text = "ff: found legal plan as follows\n\n".to_owned();
    if plan.is_temporal() {
        text.extend(plan.steps.iter().map(|step| format!("{}\n", line(step))));
        return text;
    }
    text.push_str("step ");
    for (index, step) in plan.steps.iter().enumerate() {
        let _ = write!(text, "{index:4}: {}\n     ", words(step));
    }
    text.push('\n');
    if let Some(cost) = plan.cost {
        let _ = writeln!(text, "plan cost: {cost:.6}");
    }
    text
}

fn clips(plan: &Plan, id: &str, value: &dyn Fn(&str) -> Bson) -> Result<String, PrintError> {
    let id = spelled(symbol(id))?;
    let mut text = format!("(plan (id {id})");
    if let Some(cost) = plan.cost {
        let _ = write!(text, " (cost {cost:?})");
    }
    text.push_str(")\n");
    for (index, step) in plan.steps.iter().enumerate() {
        let arguments = step.arguments.iter().map(|name| Ok(format!(" {}", spelled(slot(&value(name)))?)));
        let arguments = arguments.collect::<Result<String, PrintError>>()?;
        let number = index + 1;
        let name = spelled(symbol(&step.action))?;
        let _ = write!(text, "(plan-action (id {number}) (plan-id {id}) (name {name}) (arguments{arguments})");
        if let Some(start) = step.start {
            let _ = write!(text, " (start {start:?})");
        }
        if let Some(duration) = step.duration {
            let _ = write!(text, " (duration {duration:?})");
        }
        text.push_str(" (status FORMULATED))\n");
    }
    Ok(text)
}

/// A word of a fact that CLIPS reads as a whole.
fn spelled(word: String) -> Result<String, PrintError> {
    if word.contains('\0') { Err(PrintError::Nul(word)) } else { Ok(word) }
}

/// A value in a slot; what CLIPS has no word for is a string of JSON.
fn slot(value: &Bson) -> String {
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
fn symbol(text: &str) -> String {
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

fn dot(plan: &Plan, id: &str, value: &dyn Fn(&str) -> Bson) -> String {
    let mut text = format!("digraph \"{}\" {{\n  node [shape=box];\n  init [shape=circle, label=\"\"];\n", label(id));
    for (index, step) in plan.steps.iter().enumerate() {
        let number = index + 1;
        let arguments = step.arguments.iter().map(|name| readable(&value(name))).collect();
        let line = line(&Step { arguments, ..step.clone() });
        let _ = writeln!(text, "  s{number} [label=\"{number}: {}\"];", label(&line));
    }
    text.push_str("  goal [shape=doublecircle, label=\"\"];\n  init");
    text.extend((1..=plan.steps.len()).map(|number| format!(" -> s{number}")));
    text.push_str(" -> goal;\n}\n");
    text
}

/// A value as people read it.
fn readable(value: &Bson) -> String {
    match value {
        Bson::String(text) => text.clone(),
        other => slot(other),
    }
}

/// A text in a quoted label; what cannot be seen is written as an escape.
fn label(text: &str) -> String {
    let mut label = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '"' | '\\' => label.extend(['\\', c]),
            c if c.is_control() => label.push_str(&c.escape_default().to_string().replace('\\', "\\\\")),
            c => label.push(c),
        }
    }
    label
}
