//! Whether templates use what they are given: a goal, and parameters.

use std::collections::BTreeSet;

use super::generate::spelling;
use super::taken::Taken;
use super::{Request, Syntax, marker, minijinja};
use crate::formats::{Diagnostic, Source, Span, nearest};

/// Refuses a goal that the template does not use, and parameters that none of the templates uses; `others` are
/// rendered with the same parameters. What Fawkes accepted is accepted under [`Request::lenient`].
///
/// # Errors
/// What is not used, with the nearest name that is.
pub fn check_use(request: &Request, others: &[&Request]) -> Result<(), Diagnostic> {
    if request.lenient {
        return Ok(());
    }
    let all: Vec<(Syntax, Taken)> = std::iter::once(request).chain(others.iter().copied()).map(taken).collect();
    for (name, _) in &request.parameters {
        if !all.iter().any(|(syntax, taken)| taken.takes(name, *syntax)) {
            return Err(unused(name, &all));
        }
    }
    match (&request.goal, all.first()) {
        (Some(goal), Some((syntax, taken))) if !taken.takes_goal => Err(no_goal(goal, *syntax, request)),
        _ => Ok(()),
    }
}

/// Whether the template uses the goal.
#[must_use]
pub fn takes_goal(request: &Request) -> bool {
    taken(request).1.takes_goal
}

fn taken(request: &Request) -> (Syntax, Taken) {
    match spelling(request) {
        Ok(Syntax::Marker) => (Syntax::Marker, marker::taken(&request.template)),
        Ok(syntax) => (syntax, minijinja::taken(request)),
        Err(_) => (request.syntax, Taken::unknown()),
    }
}

fn unused(name: &str, all: &[(Syntax, Taken)]) -> Diagnostic {
    let source = Source::new("<parameter>", name);
    let message = format!("the template does not use a parameter `{name}`");
    let diagnostic = Diagnostic::new(&source, Span::new(0, name.len()), message);
    let names: BTreeSet<&str> = all.iter().flat_map(|(_, taken)| taken.names.iter().map(String::as_str)).collect();
    let list = names.iter().copied().collect::<Vec<_>>().join(", ");
    if name.eq_ignore_ascii_case("goal") {
        return diagnostic.hint("give the goal with --goal");
    }
    match nearest(name, names.iter().copied()) {
        Some(near) => diagnostic.hint(format!("did you mean `{near}`?")),
        None if list.is_empty() => diagnostic.hint("it uses no parameters; leave -D out"),
        None => diagnostic.hint(format!("it uses {list}")),
    }
}

fn no_goal(goal: &str, syntax: Syntax, request: &Request) -> Diagnostic {
    let source = Source::new("<goal>", goal);
    let message = format!("{} does not use the goal", request.template.name());
    let diagnostic = Diagnostic::new(&source, Span::new(0, goal.len()), message);
    diagnostic.hint(match syntax {
        Syntax::Marker => "write (:goal <<GOAL>>) in it, or leave --goal out",
        _ => "write (:goal {% if goal is defined %}{{ goal }}{% else %}(and …){% endif %}) in it, or leave --goal out",
    })
}
