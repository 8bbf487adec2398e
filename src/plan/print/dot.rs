//! As a graph for Graphviz.

use std::fmt::Write as _;

use super::page::PrintedPlan;
use crate::pddl::Structure;
use crate::plan::Status;
use crate::problem::names;

pub(super) fn graph(page: &PrintedPlan<'_>) -> String {
    let mut text =
        format!("digraph \"{}\" {{\n  node [shape=box];\n  init [shape=circle, label=\"\"];\n", label(page.id));
    for (index, step) in page.plan.steps.iter().enumerate() {
        let number = index + 1;
        let style = match page.status(index) {
            Status::Open => "",
            Status::Running => ", style=filled, fillcolor=lightblue",
            Status::Done => ", style=filled, fillcolor=palegreen",
            Status::Failed => ", style=filled, fillcolor=lightcoral",
        };
        let _ = writeln!(text, "  s{number} [label=\"{number}: {}\"{style}];", label(&page.readable(step)));
    }
    text.push_str("  goal [shape=doublecircle, label=\"\"];\n");
    match page.structure {
        Some(structure) => partial_order(structure, page.plan.steps.len(), &mut text),
        None => {
            text.push_str("  init");
            text.extend((1..=page.plan.steps.len()).map(|number| format!(" -> s{number}")));
            text.push_str(" -> goal;\n");
        }
    }
    text.push_str("}\n");
    text
}

/// Edges from each step to those that have to be after it, with the facts that it makes true for them.
fn partial_order(structure: &Structure, count: usize, text: &mut String) {
    for &(from, to) in &structure.order {
        let links = structure.links.iter().filter(|link| (link.from, link.to) == (from, to));
        let facts: Vec<&str> = links.map(|link| link.fact.as_str()).collect();
        let style = if facts.is_empty() {
            "style=dashed".to_owned()
        } else {
            format!(
                "label=\"{}\"",
                facts.iter().map(|fact| label(&names::readable(fact))).collect::<Vec<_>>().join("\\n")
            )
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
