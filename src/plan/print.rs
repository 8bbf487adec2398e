//! Plans as text for planners' tools, programs and people.

use std::fmt::Write as _;

use bson::{Bson, Document};

use super::report::rounded;
use super::{Status, svg};
use crate::pddl::{Plan, Step, Structure};
use crate::problem::names;

/// How a plan is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Format {
    /// As the planning competitions write it: `(unstack b a)`, `; cost = 2 (unit cost)`.
    #[default]
    Text,
    /// The document, as one line of JSON.
    Document,
    /// Facts `plan` and `plan-action`.
    Clips,
    /// As FF writes it: `step    0: unstack b a`.
    Ff,
    /// A graph for Graphviz.
    Dot,
    /// A drawing for browsers: boxes in order, or bars over time.
    Svg,
}

/// What a format has no way to write.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PrintError {
    /// CLIPS ends every text at a NUL.
    #[error("{0:?} has a NUL in it, at which CLIPS would end it")]
    Nul(String),
}

/// A plan with what is printed along with it.
#[derive(Clone, Copy)]
pub struct PrintedPlan<'a> {
    /// The plan, with the names of the problem.
    pub plan: &'a Plan,
    /// Its document, which is what [`Format::Document`] prints.
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
    /// Prints the plan; the text ends with a line break.
    ///
    /// # Errors
    ///
    /// A value that the format cannot spell.
    pub fn print(&self, format: Format) -> Result<String, PrintError> {
        match format {
            Format::Text => Ok(self.text()),
            // Documents become JSON without fail: their keys are strings.
            Format::Document => Ok(serde_json::to_string(self.document).unwrap_or_default() + "\n"),
            Format::Clips => self.clips(),
            Format::Ff => Ok(ff(self.plan)),
            Format::Dot => Ok(self.dot()),
            Format::Svg => Ok(svg::draw(self)),
        }
    }

    /// How far a step is; steps count from 0.
    pub(super) fn status(&self, index: usize) -> Status {
        self.statuses.get(index).copied().unwrap_or_default()
    }

    /// A step with the memory's values, as people read it.
    pub(super) fn readable(&self, step: &Step) -> String {
        let arguments = step.arguments.iter().map(|name| readable(&(self.value)(name))).collect();
        line(&Step { arguments, ..step.clone() })
    }

    /// `(unstack b a)`, or `0.001: (move r1 a b) [5.000]`; what is known of a step is a comment.
    fn text(&self) -> String {
        let mut text = String::new();
        for (index, step) in self.plan.steps.iter().enumerate() {
            text.push_str(&names::readable(&line(step)));
            if self.status(index) != Status::Open {
                let _ = write!(text, " ; {}", self.status(index));
            }
            text.push('\n');
        }
        let length = self.plan.steps.len() as f64;
        let makespan = self.plan.makespan().map(rounded);
        let _ = match self.plan.cost.map(rounded) {
            // Without a metric, the cost is the number of steps, which says nothing about a plan with times.
            Some(cost) if cost != length && Some(cost) != makespan => writeln!(text, "; cost = {cost} (general cost)"),
            _ if makespan.is_some() => Ok(()),
            _ => writeln!(text, "; cost = {length} (unit cost)"),
        };
        if let Some(makespan) = makespan {
            let _ = writeln!(text, "; makespan = {makespan}");
        }
        text
    }

    fn clips(&self) -> Result<String, PrintError> {
        let id = spelled(symbol(self.id))?;
        let mut text = format!("(plan (id {id})");
        if let Some(cost) = self.plan.cost {
            let _ = write!(text, " (cost {cost:?})");
        }
        text.push_str(")\n");
        for (index, step) in self.plan.steps.iter().enumerate() {
            let arguments = step.arguments.iter().map(|name| Ok(format!(" {}", spelled(slot(&(self.value)(name)))?)));
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
            let _ = writeln!(text, " (status {}))", self.status(index).symbol());
        }
        Ok(text)
    }

    fn dot(&self) -> String {
        let mut text =
            format!("digraph \"{}\" {{\n  node [shape=box];\n  init [shape=circle, label=\"\"];\n", label(self.id));
        for (index, step) in self.plan.steps.iter().enumerate() {
            let number = index + 1;
            let style = match self.status(index) {
                Status::Open => "",
                Status::Running => ", style=filled, fillcolor=lightblue",
                Status::Done => ", style=filled, fillcolor=palegreen",
                Status::Failed => ", style=filled, fillcolor=lightcoral",
            };
            let _ = writeln!(text, "  s{number} [label=\"{number}: {}\"{style}];", label(&self.readable(step)));
        }
        text.push_str("  goal [shape=doublecircle, label=\"\"];\n");
        match self.structure {
            Some(structure) => partial_order(structure, self.plan.steps.len(), &mut text),
            None => {
                text.push_str("  init");
                text.extend((1..=self.plan.steps.len()).map(|number| format!(" -> s{number}")));
                text.push_str(" -> goal;\n");
            }
        }
        text.push_str("}\n");
        text
    }
}

/// Edges from each step to those that have to be after it, with the facts that it makes true for them.
fn partial_order(structure: &Structure, count: usize, text: &mut String) {
    for &(from, to) in &structure.order {
        let links = structure.links.iter().filter(|link| (link.from, link.to) == (from, to));
        let facts: Vec<&str> = links.map(|link| link.fact.as_str()).collect();
        let style = if facts.is_empty() {
            "style=dashed".to_owned()
        } else {
            format!("label=\"{}\"", facts.iter().map(|fact| label(fact)).collect::<Vec<_>>().join("\\n"))
        };
        let _ = writeln!(text, "  s{} -> s{} [{style}];", from + 1, to + 1);
    }
    for step in 0..count {
        if structure.order.iter().all(|(_, to)| *to != step) {
            let _ = writeln!(text, "  init -> s{};", step + 1);
        }
        if structure.order.iter().all(|(from, _)| *from != step) {
            let _ = writeln!(text, "  s{} -> goal;", step + 1);
        }
    }
    if count == 0 {
        text.push_str("  init -> goal;\n");
    }
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
pub(super) fn time(time: f64) -> String {
    let short = format!("{time:.3}");
    match short.parse() == Ok(time) {
        true => short,
        false => time.to_string(),
    }
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
