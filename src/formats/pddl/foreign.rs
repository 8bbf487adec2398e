//! Spellings beside the grammar: those of other languages of planning, and one that is read with a warning.

use super::outline::{Token, Tokens};
use crate::formats::{Source, Span};

/// The first part of another language of planning: its place, and what it is.
#[must_use]
pub fn other_language(source: &Source) -> Option<(Span, &'static str)> {
    let mut tokens = Tokens::new(source.text(), 0);
    let mut is_first = false;
    while let Some(token) = tokens.next_token() {
        let Token::Word(span) = token else {
            is_first = matches!(token, Token::Open(_));
            continue;
        };
        match source.slice(span).to_ascii_lowercase().as_str() {
            "probabilistic" if is_first => return Some((span, "probabilistic effects")),
            "oneof" if is_first => return Some((span, "nondeterministic effects")),
            ":observe" => return Some((span, "sensing actions (`:observe`)")),
            _ => is_first = false,
        }
    }
    None
}

/// The types whose dash has no blank behind it, as in `?r -robot`. In a text that was read, such a word is nothing else.
#[must_use]
pub fn tight_dashes(source: &Source) -> Vec<Span> {
    let mut tokens = Tokens::new(source.text(), 0);
    let mut found = Vec::new();
    while let Some(token) = tokens.next_token() {
        if let Token::Word(span) = token {
            let rest = source.slice(span).strip_prefix('-').unwrap_or_default();
            if rest.starts_with(|c: char| c.is_ascii_alphabetic()) {
                found.push(span);
            }
        }
    }
    found
}
