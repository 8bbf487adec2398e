//! The way from a request to a problem: which syntax the template has, and the module that renders it.

use std::fs::File;

use super::request::{ProblemError, Request, Syntax};
use super::{Generated, Streamed, empty_goal, goal, marker, minijinja, unchecked};
use crate::formats::pddl::Dialect;
use crate::formats::{Diagnostic, Source, Span};
use crate::memory::Memory;
use crate::pddl::Domain;

/// Makes the problem: answers the template's queries and renders it.
///
/// The result depends on the request and the memory's content alone.
///
/// # Errors
/// A mistake in the template, a query, the goal or a parameter, at its place;
/// two values that PDDL takes for the same name; a store that fails.
pub fn generate(request: &Request, memory: &Memory) -> Result<Generated, ProblemError> {
    let (goal, syntax) = read(request)?;
    let mut generated = match syntax {
        Syntax::Marker => marker::expand(request, goal.as_deref(), memory)?,
        _ => minijinja::render(request, goal.as_deref(), memory)?,
    };
    let empty = empty_goal::remark(request, &generated);
    generated.remarks.extend(empty);
    Ok(generated)
}

/// Makes the problem without holding it, in `file` if there is one, and checks it against a domain if one is given.
/// Nothing comes back where the problem may be wrong or odd, or where the template is of a kind that is not made in
/// this way: [`generate`] is for these.
///
/// # Errors
/// A mistake in the goal or a parameter, and a store that fails.
pub fn stream(
    request: &Request,
    memory: &Memory,
    domain: Option<&Domain>,
    dialect: Dialect,
    file: Option<File>,
) -> Result<Option<Streamed>, ProblemError> {
    match read(request)? {
        (_, Syntax::Marker) => Ok(None),
        _ if unchecked::may_have_slashes(request) => Ok(None),
        (goal, _) => {
            let streamed = minijinja::stream(request, goal.as_deref(), memory, (domain, dialect), file)?;
            // Where its goal or metric is empty, a remark says where and why.
            Ok(streamed.and_then(|mut streamed| (!streamed.has_empty_part()).then_some(streamed)))
        }
    }
}

/// The goal of a request, and the syntax of its template.
fn read(request: &Request) -> Result<(Option<String>, Syntax), ProblemError> {
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
    Ok((goal, syntax))
}

/// The spelling by content; a template without any marker is fine in both.
pub(super) fn spelling(request: &Request) -> Result<Syntax, Diagnostic> {
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
