//! Goals that a template left empty: the plan has no steps, because a query matched nothing.

use super::{Generated, Request, SectionReport};
use crate::formats::pddl::{Token, Tokens};
use crate::formats::{Diagnostic, Span};

/// How many bytes of the end of a long problem are searched for its goal.
pub(super) const TAIL: usize = 64 << 10;

/// Where the empty condition of the last goal stands: `()`, `(and)` or `(and (and))`, perhaps with comments in it.
pub(super) fn find(problem: &str) -> Option<Span> {
    let is = |word: Span, wanted: &str| {
        problem.get(word.start..word.end).is_some_and(|word| word.eq_ignore_ascii_case(wanted))
    };
    let (mut rest, mut goal) = (Tokens::new(problem, 0), None);
    while let Some(token) = rest.next_token() {
        let mut behind = rest.clone();
        if matches!((token, behind.next_token()), (Token::Open(_), Some(Token::Word(head))) if is(head, ":goal")) {
            goal = Some(behind);
        }
    }
    let (mut condition, mut depth, mut is_opened, mut start) = (goal?, 0_usize, false, None);
    loop {
        let token = condition.next_token()?;
        match token {
            Token::Open(at) => {
                start.get_or_insert(at);
                depth += 1;
            }
            Token::Close(at) => {
                depth = depth.checked_sub(1)?;
                if depth == 0 {
                    return start.map(|start| Span::new(start, at + 1));
                }
            }
            Token::Word(word) if is_opened && is(word, "and") => {}
            Token::Word(_) => return None,
        }
        is_opened = matches!(token, Token::Open(_));
    }
}

/// The remark about a goal that is empty although the template does not say so, where a query matched nothing.
pub(super) fn remark(request: &Request, generated: &Generated) -> Option<Diagnostic> {
    let texts = || std::iter::once(&request.template).chain(request.parts.iter().map(|part| &part.source));
    let is_matched = |section: &SectionReport| section.matched > 0;
    if request.goal.is_some()
        || generated.sections.iter().all(is_matched)
        || texts().any(|text| find(text.text()).is_some())
    {
        return None;
    }
    let place = find(&generated.text)?;
    let complaint = Diagnostic::new(&generated.source(), place, "the goal is empty, so nothing has to be done");
    let remark = generated.explain(vec![complaint]).into_iter().next()?;
    // The queries of the goal stand at its line or below it.
    let ((line, _), name) = (remark.position(), remark.name().to_owned());
    let is_here = |part: &Option<String>| match part {
        Some(part) => request.parts.iter().any(|known| known.name == *part && known.source.name() == name),
        None => request.template.name() == name,
    };
    let empty = generated.sections.iter().filter(|section| section.matched == 0);
    let within = empty.filter(|section| section.line >= line && is_here(&section.part));
    let hint = |section: &SectionReport| format!("{}: {} matched no document", section.place(), section.name);
    Some(within.map(hint).fold(remark, Diagnostic::hint))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_goals_are_found() {
        for (problem, wanted) in [
            ("(define (:goal (and)))", Some("(and)")),
            ("(:goal\n ( AND ; none (x)\n ) )", Some("( AND ; none (x)\n )")),
            ("(:goal ())", Some("()")),
            ("(:goal (and (on a b)))", None),
            ("(:goal (on a b))", None),
            ("(:goal (and", None),
            ("(:goal )", None),
            ("(:goal (and) ;", Some("(and)")),
            ("(:init)", None),
            ("(:goal ;", None),
            ("(:GOAL (and))", Some("(and)")),
            ("( :goal (and))", Some("(and)")),
            ("( ; the\n:goal (and))", Some("(and)")),
            ("(:goal (and)) ; (:goal (on a b))", Some("(and)")),
            ("(:goal (and (and) ()))", Some("(and (and) ())")),
            ("(:goal (and (and (on a b))))", None),
            ("(:goal (or))", None),
            ("(:goal and)", None),
            ("(:goals (and))", None),
        ] {
            assert_eq!(find(problem).map(|span| &problem[span.start..span.end]), wanted, "{problem}");
        }
    }
}
