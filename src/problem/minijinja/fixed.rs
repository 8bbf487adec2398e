//! Which fixed text of a template is given a mark of its place.
//!
//! A mark in the text would be seen by what looks at the text itself: `{% filter %}`, or a comparison of what a macro
//! or a `{% set %}` block made. So text inside of these is marked only where the template writes it and does
//! nothing else with it.

use std::collections::HashSet;

use super::blocks::{closes, opens};
use super::tags::{Tag, TagKind, tags};
use crate::formats::Span;

/// What of a template gets a mark.
#[derive(Debug, Default)]
pub(super) struct Fixed {
    /// The stretches of fixed text, without the white space around them, which tags may remove.
    pub(super) stretches: Vec<Span>,
    /// Where the expressions and filters start whose text is written as it is.
    pub(super) written: HashSet<usize>,
}

impl Fixed {
    /// That of a template; `all` are the texts of all templates that are rendered together.
    pub(super) fn of(template: &str, all: &[&str]) -> Self {
        let mut fixed = Self::default();
        // Whether the text of each open block is written as it is.
        let mut open: Vec<bool> = Vec::new();
        let mut start = 0;
        for tag in tags(template) {
            let is_written = open.iter().all(|is_plain| *is_plain);
            if is_written {
                fixed.stretches.extend(stretch(template, start, tag.span.start));
                fixed.stretches.extend(tag.raw().and_then(|raw| stretch(template, raw.start, raw.end)));
            }
            if is_written && (tag.kind == TagKind::Expression || tag.word() == "filter") {
                fixed.written.insert(tag.span.start);
            }
            start = tag.span.end;
            if opens(&tag) {
                open.push(is_plain(&tag, all));
            } else if closes(&tag).is_some() {
                open.pop();
            }
        }
        if open.iter().all(|is_plain| *is_plain) {
            fixed.stretches.extend(stretch(template, start, template.len()));
        }
        fixed
    }
}

fn stretch(template: &str, start: usize, end: usize) -> Option<Span> {
    let text = template.get(start..end)?;
    let (before, after) = (text.len() - text.trim_start().len(), text.len() - text.trim_end().len());
    (before < text.len()).then(|| Span::new(start + before, end - after))
}

/// Whether the text inside of a block reaches the problem as it is.
fn is_plain(tag: &Tag<'_>, all: &[&str]) -> bool {
    match tag.word() {
        "filter" => false,
        "macro" | "set" => {
            let name = tag.words().get(1).map(|(_, name)| *name);
            let is_filtered = tag.word() == "set" && tag.code().contains('|');
            !is_filtered && name.is_some_and(|name| is_only_written(name, all))
        }
        "call" => is_only_written("caller", all),
        _ => true,
    }
}

/// Whether all that templates do with a macro or a variable is to define it and to write it.
fn is_only_written(name: &str, all: &[&str]) -> bool {
    all.iter().flat_map(|template| tags(template)).all(|tag| {
        let words = tag.words();
        let count = words.iter().filter(|(_, word)| *word == name).count();
        match (tag.kind, count) {
            (TagKind::Comment | TagKind::Raw, _) | (_, 0) => true,
            (TagKind::Expression, 1) => writes(tag.code(), name),
            (TagKind::Statement, 1) => match tag.word() {
                "macro" | "set" => words.get(1).is_some_and(|(_, word)| *word == name) && (opens(&tag)),
                "endmacro" | "endset" | "call" | "from" | "import" => true,
                _ => false,
            },
            _ => false,
        }
    })
}

/// Whether an expression is `name`, `name(…)` or `module.name(…)`.
fn writes(code: &str, name: &str) -> bool {
    let head = code.find('(').map_or(code, |at| &code[..at]).trim();
    let is_named = head.rsplit('.').next() == Some(name);
    let (mut depth, mut quote, mut closed) = (0_usize, None, None);
    for (at, c) in code.char_indices() {
        match (quote, c) {
            (Some(open), _) if c == open => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, '(') => depth += 1,
            (None, ')') => {
                depth = depth.saturating_sub(1);
                if depth == 0 && closed.is_none() {
                    closed = Some(at + 1);
                }
            }
            _ => {}
        }
    }
    is_named && closed.is_none_or(|end| end == code.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marked(template: &str) -> Vec<&str> {
        Fixed::of(template, &[template]).stretches.into_iter().map(|span| &template[span.start..span.end]).collect()
    }

    #[test]
    fn text_is_marked_unless_something_looks_at_it() {
        assert_eq!(marked(" a {% if x %}\n(b c)\n{% else %} {% endif %}d"), ["a", "(b c)", "d"]);
        assert_eq!(marked("{% filter upper %}a{% endfilter %}b{% raw %}c{% endraw %}"), ["b", "c"]);
        assert_eq!(marked("{% macro f(x) %}a{% endmacro %}{{ f(1) }}{{ m.f((2)) }}"), ["a"]);
        for used in ["{% if f(1) == 'a' %}{% endif %}", "{{ f(1)|upper }}", "{{ g(f(1)) }}", "{{ f(f(1)) }}"] {
            assert_eq!(marked(&format!("{{% macro f(x) %}}a{{% endmacro %}}{used}")), [""; 0], "{used}");
        }
        assert_eq!(marked("{% set x %}a{% endset %}{{ x }}"), ["a"]);
        assert_eq!(marked("{% set x %}a{% endset %}{{ x ~ 'b' }}"), [""; 0]);
        assert_eq!(marked("{% set x | upper %}a{% endset %}{{ x }}"), [""; 0]);
        assert_eq!(
            marked("{% macro f() %}(a {{ caller() }}){% endmacro %}{% call f() %}b{% endcall %}"),
            ["(a", ")", "b"]
        );
    }
}
