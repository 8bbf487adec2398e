//! Goals that a template left empty: the plan has no steps, because a query matched nothing.

use super::{Generated, Request, SectionReport};
use crate::formats::{Diagnostic, Span};

/// How many bytes of the end of a long problem are searched for its goal.
pub(super) const TAIL: usize = 64 << 10;

/// Where the empty condition of a goal stands: `()` or `(and)`, perhaps with comments in it.
pub(super) fn find(problem: &str) -> Option<Span> {
    let start = problem.rfind("(:goal")? + "(:goal".len();
    let mut rest = problem.get(start..)?;
    let mut brackets = [None; 2];
    let mut words = Vec::new();
    loop {
        rest = rest.trim_start();
        let at = problem.len() - rest.len();
        match rest.chars().next()? {
            ';' => rest = rest.find('\n').and_then(|end| rest.get(end..))?,
            '(' if brackets[0].is_none() => {
                brackets[0] = Some(at);
                rest = rest.get(1..)?;
            }
            ')' => {
                brackets[1] = Some(at + 1);
                break;
            }
            _ => {
                let end = rest.find(|c: char| c.is_whitespace() || "();".contains(c)).filter(|end| *end > 0)?;
                words.push(rest.get(..end)?);
                rest = rest.get(end..)?;
            }
        }
    }
    let is_empty = words.is_empty() || (words.len() == 1 && words[0].eq_ignore_ascii_case("and"));
    let [Some(start), Some(end)] = brackets else { return None };
    is_empty.then(|| Span::new(start, end))
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
        ] {
            assert_eq!(find(problem).map(|span| &problem[span.start..span.end]), wanted, "{problem}");
        }
    }
}
