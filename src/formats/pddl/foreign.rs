//! Spellings beside the grammar: those of other languages of planning, and one that is read with a warning.

use super::outline::{Token, Tokens};
use crate::formats::{Source, Span};

/// The first part of another language of planning: its place, and what it is.
#[must_use]
pub fn other_language(source: &Source) -> Option<Foreign> {
    const UNSURE: &str = "what actions do has to be certain and known";
    const BY_ITSELF: &str = "what changes by itself may only be timed initial literals: `(at 5 (p))`";
    const TOGETHER: &str = "rmem plans one problem for all agents; make them parameters of its actions";
    let mut tokens = Tokens::new(source.text(), 0);
    let mut is_first = false;
    // The words since `(at`, where these are a time and then brackets.
    let mut timed: Vec<Span> = Vec::new();
    while let Some(token) = tokens.next_token() {
        let Token::Word(span) = token else {
            is_first = matches!(token, Token::Open(_));
            if !is_first {
                timed.clear();
            }
            continue;
        };
        let word = source.slice(span).to_ascii_lowercase();
        let (what, hint) = match word.as_str() {
            "probabilistic" if is_first => ("probabilistic effects", UNSURE),
            "oneof" if is_first => ("nondeterministic effects", UNSURE),
            ":observe" => ("sensing actions (`:observe`)", UNSURE),
            ":non-deterministic" => ("nondeterministic effects (`:non-deterministic`)", UNSURE),
            ":process" if is_first => ("processes (`:process`)", BY_ITSELF),
            ":event" if is_first => ("events (`:event`)", BY_ITSELF),
            ":agent" if !is_first => ("actions with an agent (`:agent`)", TOGETHER),
            ":factored-privacy" => ("private facts of agents (`:factored-privacy`)", TOGETHER),
            ":unfactored-privacy" => ("private facts of agents (`:unfactored-privacy`)", TOGETHER),
            ":private" if is_first => ("private facts of agents (`:private`)", TOGETHER),
            "=" if is_first && timed.len() == 2 => ("numbers that are set at a time (`(at 5 (= (f) 2))`)", BY_ITSELF),
            _ => {
                match timed.len() {
                    _ if is_first && word == "at" => timed = vec![span],
                    1 if !is_first && word.parse::<f64>().is_ok() => timed.push(span),
                    _ => timed.clear(),
                }
                is_first = false;
                continue;
            }
        };
        return Some(Foreign { span, what, hint });
    }
    None
}

/// A part of another language of planning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Foreign {
    /// Where it is.
    pub span: Span,
    /// What it is.
    pub what: &'static str,
    /// What takes its place here.
    pub hint: &'static str,
}

/// The types whose dash has no blank behind it, as in `?r -robot`. In a text that was read, such a word is nothing else.
#[must_use]
pub fn tight_dashes(source: &Source) -> Vec<Span> {
    if !may_have_tight_dash(source.text().as_bytes()) {
        return Vec::new();
    }
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

/// Whether a letter follows a dash with which a word may begin, also in comments.
fn may_have_tight_dash(text: &[u8]) -> bool {
    let is_letter = |at: usize| text.get(at).is_some_and(u8::is_ascii_alphabetic);
    let begins = |at: usize| at == 0 || !matches!(text[at - 1], b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'_' | b'-');
    memchr::memchr_iter(b'-', text).any(|at| is_letter(at + 1) && begins(at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dash_is_tight_wherever_a_word_may_begin() {
        for (text, found) in [
            ("(?r -robot)", 1),
            ("(?r -robot ?b\n-box)", 2),
            ("(-robot)", 1),
            ("-robot", 1),
            ("(?r - robot)", 0),
            ("(on-table a--b x_-y 4-a)", 0),
            ("(- 1 -2)", 0),
            ("; -comment\n(a -b)", 1),
            ("(a\u{a0}-b)", 0),
            ("\u{feff}-a", 1),
        ] {
            let source = Source::new("p", text);
            assert_eq!(tight_dashes(&source).len(), found, "{text}");
        }
    }
}
