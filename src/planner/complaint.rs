//! What a planner has against its input, at the place in the user's own files.
//!
//! A planner is sent a task that rmem has written, so that the lines it names are not the user's. They are found
//! again by the section they are in: the action of that name, or the section of that keyword.

use std::path::Path;

use super::files::{DOMAIN_FILE, PROBLEM_FILE};
use super::task::Task;
use crate::formats::Source;
use crate::formats::pddl::portable::Sent;
use crate::formats::plan::Complaint;

/// The complaint with the user's file and line; none where it names no line of a file of the run.
pub(super) fn located(complaint: &Complaint, sent: &Sent, task: &Task<'_>) -> Option<String> {
    let file = Path::new(complaint.file.as_deref()?).file_name()?.to_str()?;
    let (text, source) = match file {
        DOMAIN_FILE => (&sent.domain, task.domain.source()),
        PROBLEM_FILE => (&sent.problem, task.problem.source()),
        _ => return None,
    };
    let place = section(text, complaint).and_then(|(keyword, nth)| find(source, &keyword, nth, task));
    let place = place.map_or_else(String::new, |line| format!(":{line}"));
    let moved = Complaint { file: None, line: None, ..complaint.clone() };
    Some(format!("{}{place}: {moved}", source.name()))
}

/// The keyword of the section that a complaint is about, and how many sections of that keyword are before it.
fn section(text: &str, complaint: &Complaint) -> Option<(String, usize)> {
    let line = complaint.line?;
    let end = text.split_inclusive('\n').take(line).map(str::len).sum();
    let before = text.get(..end)?.to_ascii_lowercase();
    let named = complaint.token.as_ref().map(|token| token.to_ascii_lowercase());
    let named = named.filter(|token| token.starts_with(':') && before.contains(&format!("({token}")));
    let start = match &named {
        Some(token) => before.rfind(&format!("({token}"))?,
        None => before.rfind("(:")?,
    };
    let rest = before.get(start + 1..)?;
    let keyword = rest.split(|c: char| c.is_whitespace() || "()".contains(c)).next()?.to_owned();
    let nth = before.get(..start)?.matches(&format!("({keyword}")).count();
    Some((keyword, nth))
}

/// The line of the section in the user's text.
fn find(source: &Source, keyword: &str, nth: usize, task: &Task<'_>) -> Option<usize> {
    if keyword == ":action" {
        let name = &task.domain.tree().actions.get(nth)?.name;
        return Some(source.position(name.span().start).0);
    }
    let text = source.text().to_ascii_lowercase();
    let is_head = |at: &usize| {
        let line = text.get(..*at).unwrap_or_default().rsplit('\n').next().unwrap_or_default();
        let follows = text.get(at + keyword.len()..).unwrap_or_default();
        line.trim_end().ends_with('(')
            && !line.contains(';')
            && !follows.starts_with(|c: char| c.is_alphanumeric() || c == '-')
    };
    let found = text.match_indices(keyword).map(|(at, _)| at).filter(is_head).nth(nth)?;
    Some(source.position(found).0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::pddl::Dialect;
    use crate::pddl::{Domain, Problem};

    #[test]
    fn a_section_is_found_behind_letters_that_are_longer_in_lower_case() {
        let text = format!("; {}\n(define (domain d)\n  (:PREDICATES (p))\n  (:action a :effect (p)))", "İ".repeat(60));
        let source = Source::new("d.pddl", text);
        let domain = Domain::read(&source, Dialect::default()).unwrap();
        let problem = Source::new("p.pddl", "(define (problem q) (:domain d) (:init) (:goal (p)))");
        let problem = Problem::read(&problem, &domain, Dialect::default()).unwrap();
        assert_eq!(find(&source, ":predicates", 0, &Task { domain: &domain, problem: &problem }), Some(3));
    }
}
