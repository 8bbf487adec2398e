//! The blocks of a minijinja template: which tag opens, which one closes, and what is between.

use super::tags::{Tag, TagKind, tags, words};
use crate::formats::{Diagnostic, Source, Span};

/// The statements that have an end.
const OPENERS: [&str; 9] = ["for", "if", "macro", "block", "filter", "call", "with", "autoescape", "set"];

/// Whether a statement opens a block; `{% set x = … %}` does not.
pub(super) fn opens(tag: &Tag<'_>) -> bool {
    tag.kind == TagKind::Statement && OPENERS.contains(&tag.word()) && !(tag.word() == "set" && assigns(tag.code()))
}

/// The word of the block that a statement closes.
pub(super) fn closes<'a>(tag: &Tag<'a>) -> Option<&'a str> {
    let word = tag.word().strip_prefix("end").filter(|word| OPENERS.contains(word));
    word.filter(|_| tag.kind == TagKind::Statement)
}

/// Whether code has a `=` that is no comparison, outside of strings and brackets.
fn assigns(code: &str) -> bool {
    let bytes = code.as_bytes();
    let (mut depth, mut quote) = (0_usize, None);
    for (at, byte) in bytes.iter().copied().enumerate() {
        match (quote, byte) {
            (Some(open), _) if byte == open => quote = None,
            (Some(_), _) => {}
            (None, b'"' | b'\'') => quote = Some(byte),
            (None, b'(' | b'[' | b'{') => depth += 1,
            (None, b')' | b']' | b'}') => depth = depth.saturating_sub(1),
            (None, b'=') if depth == 0 && bytes.get(at + 1) != Some(&b'=') => return true,
            // A filter that the set block goes through.
            (None, b'|') if depth == 0 => return false,
            _ => {}
        }
    }
    false
}

/// The block that is not closed: where it was opened, and what was expected.
pub(super) fn unclosed(template: &Source) -> Option<Diagnostic> {
    let mut open: Vec<Tag<'_>> = Vec::new();
    let (mut missing, mut instead) = (None, String::new());
    for tag in tags(template.text()) {
        if opens(&tag) {
            open.push(tag);
        }
        let Some(closed) = closes(&tag) else { continue };
        match open.last() {
            Some(last) if last.word() == closed => drop(open.pop()),
            Some(last) if open.iter().any(|opened| opened.word() == closed) => {
                missing = Some(*last);
                let (line, column) = template.position(tag.span.start);
                instead = format!("{{% end{closed} %}} at {line}:{column}");
                break;
            }
            _ => return None,
        }
    }
    let opened = missing.or(open.last().copied())?;
    let word = opened.word();
    if instead.is_empty() {
        instead = "the end of the template".to_owned();
    }
    let message = format!("{{% {word} %}} is not closed: expected {{% end{word} %}} before {instead}");
    Some(Diagnostic::new(template, opened.span, message))
}

/// A block around a place of a template.
#[derive(Debug)]
pub(in crate::problem) struct Around {
    /// Its tag: the opening one, or the `elif` or `else` that the place is behind.
    pub(in crate::problem) span: Span,
    pub(in crate::problem) is_loop: bool,
    /// When it is written, where that is not always: `if x`, `if not x`.
    pub(in crate::problem) condition: Option<String>,
}

/// The blocks around the text at `offset`, the outermost first.
pub(in crate::problem) fn around(template: &str, offset: usize) -> Vec<Around> {
    let mut open: Vec<Around> = Vec::new();
    for tag in tags(template).take_while(|tag| tag.span.start < offset) {
        let code = tag.code().split_whitespace().collect::<Vec<_>>().join(" ");
        if opens(&tag) {
            let condition = match tag.word() {
                "if" => Some(code),
                "for" => selection(&code).map(|condition| format!("if {condition}")),
                _ => None,
            };
            open.push(Around { span: tag.span, is_loop: tag.word() == "for", condition });
        } else if closes(&tag).is_some() {
            open.pop();
        } else if let (Some(block), "elif" | "else") = (open.last_mut(), tag.word()) {
            block.span = tag.span;
            block.condition = match tag.word() {
                "elif" => Some(code.replacen("elif", "if", 1)),
                _ if block.is_loop => Some("where the loop has nothing to go through".to_owned()),
                _ => block.condition.as_deref().map(negated),
            };
        }
    }
    open
}

/// The condition of the `else` after an `if`.
fn negated(condition: &str) -> String {
    format!("if not ({})", condition.trim_start_matches("if").trim())
}

/// The condition of `for x in y if condition`.
fn selection(code: &str) -> Option<&str> {
    let is_outside = |at: usize| {
        let before = code.get(..at).unwrap_or_default();
        before.matches(['(', '[', '{']).count() <= before.matches([')', ']', '}']).count()
    };
    let (at, word) = words(code).into_iter().find(|(at, word)| *word == "if" && is_outside(*at))?;
    code.get(at + word.len()..).map(|condition| condition.trim().trim_end_matches(" recursive"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complaint(text: &str) -> Option<String> {
        unclosed(&Source::new("t", text)).map(|error| error.to_string().lines().next().unwrap_or_default().to_owned())
    }

    #[test]
    fn a_block_without_end_is_named_where_it_was_opened() {
        for (text, wanted) in [
            ("a\n {% if x %}b", "t:2:2: {% if %} is not closed: expected {% endif %} before the end of the template"),
            (
                "{% for x in y %}{% if x %}\n{% endfor %}",
                "t:1:17: {% if %} is not closed: expected {% endif %} before {% endfor %} at 2:1",
            ),
            (
                "{% set x %}{{ x }}",
                "t:1:1: {% set %} is not closed: expected {% endset %} before the end of the template",
            ),
        ] {
            assert_eq!(complaint(text).as_deref(), Some(wanted));
        }
        for text in [
            "{% set x = 1 %}{% if x == 1 %}{% else %}{% endif %}",
            "{% set x | upper %}a{% endset %}",
            "{% endif %}",
            "{# {% if x %} #}{% raw %}{% if %}{% endraw %}",
        ] {
            assert_eq!(complaint(text), None, "{text}");
        }
    }

    #[test]
    fn conditions_are_those_around_a_place() {
        let text = "{% for m in query('a', {'if': 1}) if m.x == 'if' %}{% if a %}{% endif %}{% if b %}{% else %}HERE";
        let found: Vec<_> = around(text, text.find("HERE").unwrap()).into_iter().map(|one| one.condition).collect();
        assert_eq!(found, [Some("if m.x == 'if'".to_owned()), Some("if not (b)".to_owned())]);
        let text = "{% for m in x %}{% if a %}{% elif b == 'c' %}HERE";
        let found: Vec<_> = around(text, text.find("HERE").unwrap()).into_iter().map(|one| one.condition).collect();
        assert_eq!(found, [None, Some("if b == 'c'".to_owned())]);
    }
}
