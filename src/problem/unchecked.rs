//! Remarks on what a domain's check would refuse, for problems that are written without one, and on `//` comments, which only
//! `--lenient` takes.

use super::{Generated, Request};
use crate::formats::pddl::{Token, Tokens};
use crate::formats::{Diagnostic, Span};

/// The remarks on a problem: an empty metric, and the first comment that begins with `//`.
#[must_use]
pub fn unchecked(generated: &Generated) -> Vec<Diagnostic> {
    let source = generated.source();
    let metric = empty_metric(&generated.text).map(|place| {
        Diagnostic::new(&source, place, "the metric is empty, which is not PDDL")
            .hint("this is written (:metric minimize EXPRESSION); leave all of it out where there is no expression")
    });
    let slashes = slashes(&generated.text).map(|place| {
        Diagnostic::new(&source, place, "the problem has a comment that begins with `//`, which is not PDDL")
            .hint("comments begin with `;`; rmem reads `//` with --lenient, planners and other programs do not")
    });
    generated.explain(metric.into_iter().chain(slashes).collect())
}

/// Where a metric without an expression stands: `(:metric minimize )`.
pub(super) fn empty_metric(problem: &str) -> Option<Span> {
    let is = |word: Span, wanted: &[&str]| {
        problem
            .get(word.start..word.end)
            .is_some_and(|word| wanted.iter().any(|wanted| word.eq_ignore_ascii_case(wanted)))
    };
    let mut tokens = Tokens::new(problem, 0);
    while let Some(token) = tokens.next_token() {
        let Token::Open(start) = token else { continue };
        let mut inside = tokens.clone();
        if !matches!(inside.next_token(), Some(Token::Word(head)) if is(head, &[":metric"])) {
            continue;
        }
        let direction = inside.next_token();
        let last = match direction {
            Some(Token::Word(word)) if is(word, &["minimize", "maximize"]) => inside.next_token(),
            other => other,
        };
        if let Some(Token::Close(end)) = last {
            return Some(Span::new(start, end + 1));
        }
    }
    None
}

/// Where a word begins with `//`.
pub(super) fn slashes(text: &str) -> Option<Span> {
    let mut tokens = Tokens::new(text, 0);
    while let Some(token) = tokens.next_token() {
        if let Token::Word(word) = token
            && text.get(word.start..).is_some_and(|rest| rest.starts_with("//"))
        {
            return Some(Span::new(word.start, word.start + 2));
        }
    }
    None
}

/// Whether a text of a template may put a `//` comment into the problem.
pub(super) fn may_have_slashes(request: &Request) -> bool {
    let mut texts = std::iter::once(&request.template).chain(request.parts.iter().map(|part| &part.source));
    texts.any(|source| slashes(source.text()).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_metrics_and_slashes_are_found() {
        for (problem, metric, comment) in [
            ("(define (:metric minimize ))", Some("(:metric minimize )"), None),
            ("( :METRIC Maximize ; x\n)", Some("( :METRIC Maximize ; x\n)"), None),
            ("(:metric)", Some("(:metric)"), None),
            ("(:metric minimize (total-cost))", None, None),
            ("(:metric minimize total-time)", None, None),
            ("(:metric minimize", None, None),
            ("(a) // (:metric x)", None, Some("//")),
            ("(a) ; http://x // y\n(b)", None, None),
            ("(a b//c)", None, None),
            ("(//a)", None, Some("//")),
        ] {
            let text = |span: Option<Span>| span.map(|span| &problem[span.start..span.end]);
            assert_eq!((text(empty_metric(problem)), text(slashes(problem))), (metric, comment), "{problem}");
        }
    }
}
