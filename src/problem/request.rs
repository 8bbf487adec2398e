//! What is asked for, and what can go wrong.

use bson::{Bson, Document};

use super::{Generated, goal, marker, minijinja};
use crate::formats::{Diagnostic, Source, Span};
use crate::memory::Memory;
use crate::store::{Namespace, StoreError};

/// The spelling of a template.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Syntax {
    /// Told by the content.
    #[default]
    Auto,
    /// `{{ … }}` and `{% … %}`.
    Minijinja,
    /// `<<key>>` and `<<#NAME|{query}>>`, as in Fawkes.
    Marker,
}

/// A problem wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The template.
    pub template: Source,
    /// Its spelling.
    pub syntax: Syntax,
    /// What the sections of the marker spelling query.
    pub collection: Namespace,
    /// PDDL text for `goal` and `<<GOAL>>`; several expressions are joined by `and`.
    pub goal: Option<String>,
    /// Variables of the template, by name. They are values, never PDDL text.
    pub parameters: Vec<(String, Bson)>,
    /// In the marker spelling, what has no value becomes empty, as in Fawkes, instead of an error.
    pub lenient: bool,
}

/// A query of the template and what it gave.
#[derive(Debug, Clone, PartialEq)]
pub struct SectionReport {
    /// The section's name, or the call in the template.
    pub name: String,
    /// What was queried.
    pub namespace: Namespace,
    /// The query: a filter, `{pipeline: […]}`, or `{distinct: field, query: …}`.
    pub query: Document,
    /// How many documents (or distinct values) the template took from it, over all times it was asked.
    pub matched: u64,
    /// The line of the template, from 1.
    pub line: usize,
}

/// Why there is no problem.
#[derive(Debug, thiserror::Error)]
pub enum ProblemError {
    /// The template, a query in it, the goal or a parameter is wrong.
    #[error(transparent)]
    Template(#[from] Diagnostic),
    /// The store failed while it answered.
    #[error("{error}")]
    Store {
        /// The place in the template, like `t.j2:3:5`.
        place: String,
        /// What the store said.
        #[source]
        error: StoreError,
    },
}

impl ProblemError {
    /// A store's complaint about the query at `span`: the template's fault if the query is bad.
    pub(super) fn store(source: &Source, span: Span, error: StoreError) -> Self {
        match error {
            StoreError::Query(error) => Self::Template(Diagnostic::new(source, span, error.message)),
            error => {
                let (line, column) = source.position(span.start);
                Self::Store { place: format!("{}:{line}:{column}", source.name()), error }
            }
        }
    }
}

/// Makes the problem: answers the template's queries and renders it.
///
/// The result depends on the request and the memory's content alone.
///
/// # Errors
/// A mistake in the template, a query, the goal or a parameter, at its place;
/// two values that PDDL takes for the same name; a store that fails.
pub fn generate(request: &Request, memory: &Memory) -> Result<Generated, ProblemError> {
    let goal = request.goal.as_deref().map(goal::parse).transpose()?;
    let syntax = spelling(request)?;
    for (name, _) in &request.parameters {
        let taken = match syntax {
            Syntax::Marker => name == "GOAL",
            _ => name == "goal" || name == "param" || minijinja::PLACED.contains(&name.as_str()),
        };
        if taken {
            let source = Source::new("<parameter>", name.as_str());
            let message = format!("a parameter cannot be called `{name}`, which templates have already");
            let diagnostic = Diagnostic::new(&source, Span::new(0, name.len()), message);
            let goal = name.eq_ignore_ascii_case("goal");
            return Err(if goal { diagnostic.hint("give the goal with --goal") } else { diagnostic }.into());
        }
    }
    match syntax {
        Syntax::Marker => marker::expand(request, goal.as_deref(), memory),
        _ => minijinja::render(request, goal.as_deref(), memory),
    }
}

/// The spelling by content; a template without any marker is fine in both.
fn spelling(request: &Request) -> Result<Syntax, Diagnostic> {
    if request.syntax != Syntax::Auto {
        return Ok(request.syntax);
    }
    let text = request.template.text();
    let minijinja = ["{{", "{%", "{#"].iter().filter_map(|mark| text.find(mark)).min();
    let Some(marker) = first_marker(text) else { return Ok(Syntax::Minijinja) };
    // A query may hold `{{`, a marker in an expression of minijinja is hardly meant.
    match minijinja {
        None => Ok(Syntax::Marker),
        Some(_) if only_in_markers(text) => Ok(Syntax::Marker),
        Some(_) => {
            let message = "the template has markers of both spellings, `<<…>>` and `{{…}}`";
            let diagnostic = Diagnostic::new(&request.template, Span::at(marker), message);
            Err(diagnostic.hint("say which is meant: --syntax marker or --syntax minijinja"))
        }
    }
}

/// The first `<<` that can start a marker.
fn first_marker(text: &str) -> Option<usize> {
    text.match_indices("<<").map(|(offset, _)| offset).find(|offset| {
        let rest = text.get(offset + 2..).unwrap_or_default();
        rest.starts_with(|c: char| c.is_alphanumeric() || "_#/!<".contains(c)) && rest.contains(">>")
    })
}

/// Whether every `{{`, `{%` and `{#` stands inside of a `<<…>>`.
fn only_in_markers(text: &str) -> bool {
    let mut rest = text;
    while let Some(start) = rest.find("<<") {
        let before = rest.get(..start).unwrap_or_default();
        if ["{{", "{%", "{#"].iter().any(|mark| before.contains(mark)) {
            return false;
        }
        rest = rest.get(start..).and_then(|marker| marker.split_once(">>")).map_or("", |(_, after)| after);
    }
    !["{{", "{%", "{#"].iter().any(|mark| rest.contains(mark))
}
