//! Concrete syntax for messages, and which part of a section a place is in.

use super::outline::{Token, Tokens};
use crate::formats::{Diagnostic, Source, Span};

const ACTION: &str = "(:action NAME :parameters (…) :precondition (…) :effect (…))";
const DURATIVE_ACTION: &str =
    "(:durative-action NAME :parameters (…) :duration (= ?duration …) :condition (…) :effect (…))";

/// How a section is written, by its keyword in lower case.
pub(super) fn of_section(keyword: &str) -> Option<&'static str> {
    Some(match keyword {
        ":requirements" => "(:requirements :strips :typing …)",
        ":types" => "(:types SUBTYPE … - TYPE …)",
        ":constants" => "(:constants NAME … - TYPE …)",
        ":objects" => "(:objects NAME … - TYPE …)",
        ":predicates" => "(:predicates (NAME ?x - TYPE …) …)",
        ":functions" => "(:functions (NAME ?x - TYPE …) - number …)",
        ":constraints" => "(:constraints (and (always (…)) …))",
        ":derived" => "(:derived (NAME ?x - TYPE …) (…))",
        ":action" => ACTION,
        ":durative-action" => DURATIVE_ACTION,
        ":domain" => "(:domain NAME)",
        ":init" => "(:init (NAME OBJECT …) (= (FUNCTION OBJECT …) NUMBER) …)",
        ":goal" => "(:goal (and (NAME OBJECT …) …))",
        ":metric" => "(:metric minimize EXPRESSION)",
        ":length" => "(:length (:serial NUMBER) (:parallel NUMBER))",
        _ => return None,
    })
}

/// The keyword of a section in lower case, and where it stands.
pub(super) fn keyword(source: &Source, section: Span) -> Option<(String, Span)> {
    match Tokens::new(source.text(), section.start + 1).next_token()? {
        Token::Word(span) if span.end <= section.end => Some((source.slice(span).to_ascii_lowercase(), span)),
        _ => None,
    }
}

/// Says in which part of which section a complaint is, and how that is written.
pub(super) fn explain(source: &Source, section: Span, flaw: &Diagnostic) -> Diagnostic {
    let Some((keyword, _)) = keyword(source, section) else { return flaw.clone() };
    let place = place(source, section, &keyword, flaw.span().start);
    let mut diagnostic = Diagnostic::new(source, flaw.span(), format!("{place}: {}", flaw.message()));
    if let Some(syntax) = of_section(&keyword) {
        diagnostic = diagnostic.hint(format!("this is written {syntax}"));
    }
    diagnostic
}

/// `in action `pick`, in its precondition`; `in `:init``.
fn place(source: &Source, section: Span, keyword: &str, at: usize) -> String {
    let kind = match keyword {
        ":action" | ":durative-action" => "action",
        ":derived" => return "in a derived predicate".to_owned(),
        other => return format!("in `{other}`"),
    };
    let (mut depth, mut name, mut part) = (0, None, None);
    let mut tokens = Tokens::new(source.text(), section.start);
    while let Some(token) = tokens.next_token() {
        match token {
            Token::Open(offset) | Token::Close(offset) if offset >= at => break,
            Token::Word(span) if span.start >= at => break,
            Token::Open(_) => depth += 1,
            Token::Close(_) => depth -= 1,
            Token::Word(span) if depth == 1 => match source.slice(span) {
                word if word.starts_with(':') && word.len() > 1 => part = Some(word[1..].to_ascii_lowercase()),
                word => name = name.or(Some(word)),
            },
            Token::Word(_) => {}
        }
    }
    let name = name.map_or_else(|| format!("in an {kind}"), |name| format!("in {kind} `{name}`"));
    if depth == 1 && source.text().get(at..).is_some_and(|rest| rest.starts_with(':')) {
        // The next part, or what stands in its place.
        return name;
    }
    match part.as_deref() {
        Some(part @ ("parameters" | "vars" | "precondition" | "condition" | "duration" | "effect")) => {
            format!("{name}, in its {part}")
        }
        _ => name,
    }
}
