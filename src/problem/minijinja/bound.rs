//! How long an expression of a minijinja template may be.
//!
//! minijinja bounds how deep brackets and blocks nest, but it builds a chain
//! (`1+1+…`, `a|f|f…`, `not not …`, `a[0][0]…`, `{% elif %}` after `{% elif %}`) one level
//! per link as well, and goes through it by recursion. So links are counted
//! before it sees the template. Blocks are counted for the passes before it.

use super::tags::{TagKind, tags};
use crate::formats::{Diagnostic, Source, Span};

/// The most links of one expression, over all the brackets that are open at once.
const LINKS: usize = 1_000;
/// The most `{% elif %}` over all the `{% if %}` that are open at once.
const BRANCHES: usize = 500;
/// The most blocks that are open at once, as minijinja has it.
const BLOCKS: usize = 150;
/// Words that join two expressions, or stand before one.
const WORDS: [&str; 7] = ["and", "or", "not", "if", "else", "is", "in"];

/// Refuses a template whose expressions are too long for minijinja, at the link that is too much.
pub(super) fn check(template: &Source) -> Result<(), Diagnostic> {
    let mut branches: Vec<usize> = Vec::new();
    let (mut open, mut blocks) = (0, 0_usize);
    for tag in tags(template.text()) {
        match (tag.kind, tag.word()) {
            (TagKind::Comment | TagKind::Raw, _) => continue,
            (TagKind::Statement, "if") => branches.push(0),
            (TagKind::Statement, "elif") => {
                open += 1;
                branches.last_mut().into_iter().for_each(|count| *count += 1);
            }
            (TagKind::Statement, "endif") => open -= branches.pop().unwrap_or(0).min(open),
            _ => {}
        }
        if tag.kind == TagKind::Statement {
            match tag.word() {
                "if" | "for" | "with" | "filter" | "macro" | "call" | "block" => blocks += 1,
                word if word.starts_with("end") && word != "endset" => blocks = blocks.saturating_sub(1),
                _ => {}
            }
        }
        if blocks > BLOCKS {
            return Err(Diagnostic::new(template, tag.span, format!("more than {BLOCKS} blocks are open here"))
                .hint("each {% if %}, {% for %} and other block needs its {% endif %}, {% endfor %} or other end"));
        }
        if open > BRANCHES {
            let message = format!("more than {BRANCHES} `elif` in one condition");
            return Err(Diagnostic::new(template, tag.span, message)
                .hint("look the value up in a map: {{ {'a': 1, 'b': 2}[x] }}"));
        }
        if let Some(at) = too_long(tag.text) {
            let message = format!("an expression has more than {LINKS} operators");
            return Err(Diagnostic::new(template, Span::at(tag.span.start + at), message)
                .hint("take it apart with {% set part = … %}"));
        }
    }
    Ok(())
}

/// The offset in a tag of the link that is one too many. A comma ends the chains of its bracket.
fn too_long(tag: &str) -> Option<usize> {
    let mut links: Vec<usize> = vec![0];
    let (mut total, mut quote, mut escaped) = (0, None, false);
    let (mut value_before, mut word) = (false, String::new());
    for (at, c) in tag.char_indices() {
        if let Some(mark) = quote {
            (escaped, quote) = if escaped { (false, quote) } else { (c == '\\', quote.filter(|_| c != mark)) };
            continue;
        }
        if c.is_alphanumeric() || c == '_' {
            word.push(c);
            continue;
        }
        let mut new = usize::from(WORDS.contains(&word.as_str()));
        value_before = (value_before && word.is_empty()) || (!word.is_empty() && new == 0);
        word.clear();
        match c {
            '"' | '\'' => {
                // Strings side by side make no chain, but one after a value is none either.
                quote = Some(c);
                value_before = true;
            }
            _ if c.is_whitespace() => {}
            '(' | '[' | '{' => {
                // A call or an index of what stands before.
                new += usize::from(value_before);
                value_before = false;
            }
            ')' | ']' | '}' => value_before = true,
            ',' => value_before = false,
            _ => {
                new += 1;
                value_before = false;
            }
        }
        total += new;
        links.last_mut().into_iter().for_each(|count| *count += new);
        match c {
            '(' | '[' | '{' => links.push(0),
            ')' | ']' | '}' if links.len() > 1 => {
                total -= links.pop().unwrap_or(0);
            }
            ',' => {
                total -= links.last_mut().map_or(0, std::mem::take);
            }
            _ => {}
        }
        if total > LINKS {
            return Some(at);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(text: String) -> Result<(), String> {
        check(&Source::new("t", text)).map_err(|error| error.to_string())
    }

    #[test]
    fn long_lists_are_no_chains() {
        for element in ["1", "-1", "'a b'", "{'a': x.y|f}", "[1, [2]]", "f(1)"] {
            assert_eq!(checked(format!("{{% set x = [{}] %}}", format!("{element}, ").repeat(20_000))), Ok(()));
        }
        assert_eq!(checked("{{ a.b|c }}".repeat(20_000)), Ok(()));
        assert_eq!(checked("{% if a %}{% elif b %}{% endif %}".repeat(2_000)), Ok(()));
    }

    #[test]
    fn blocks_that_are_open_at_once_are_counted() {
        assert_eq!(checked("{% if a %}{% for b in c %}{% endfor %}{% endif %}".repeat(2_000)), Ok(()));
        assert_eq!(checked("{% if a %}".repeat(150) + &"{% endif %}".repeat(150)), Ok(()));
        let error = checked("{% if a %}".repeat(200_000)).unwrap_err();
        assert!(error.starts_with("t:1:1501: more than 150 blocks are open here"), "{error}");
    }

    #[test]
    fn a_chain_is_refused_where_it_gets_too_long() {
        let error = checked(format!("\n{{{{ 1{} }}}}", "+1".repeat(50_000))).unwrap_err();
        assert!(error.starts_with("t:2:2005: an expression has more than 1000 operators"), "{error}");
    }
}
