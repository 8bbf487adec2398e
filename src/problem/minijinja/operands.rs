//! The operands of `~` and `+` in the code of a tag, whose sizes are bounded.
//!
//! minijinja has no hook for its operators, so filters that give back their value look at what is added: `a ~ b` becomes
//! `a|_written ~ b|_written`, and `a + b` becomes `a|_sized + b|_sized`. Literals are left alone.

use std::collections::BTreeMap;

use super::comparisons::{Token, TokenKind, tokens};

/// The filter of an operand of `+`.
pub(super) const SIZED: &str = "_sized";
/// The filter of an operand of `~`, which writes it as text.
pub(super) const WRITTEN: &str = "_written";

/// Words that are no values.
const KEYWORDS: [&str; 8] = ["and", "or", "not", "if", "else", "is", "in", "recursive"];

/// The filters that are added to the code of a tag, with their offsets, in order.
pub(super) fn operands(code: &str) -> Vec<(usize, String)> {
    if !code.contains(['~', '+']) {
        return Vec::new();
    }
    let tokens = tokens(code, code.starts_with("{%"));
    let mut filters: BTreeMap<usize, &str> = BTreeMap::new();
    for (at, token) in tokens.iter().enumerate().filter(|(_, token)| token.kind == TokenKind::Mark) {
        let filter = match token.text {
            "~" => WRITTEN,
            "+" => SIZED,
            _ => continue,
        };
        for end in [left(&tokens, at), right(&tokens, at)].into_iter().flatten() {
            let known = filters.entry(end).or_insert(filter);
            if filter == WRITTEN {
                *known = filter;
            }
        }
    }
    filters.into_iter().map(|(end, filter)| (end, format!("|{filter}"))).collect()
}

/// The end of the operand before an operator; nothing where it is a literal, or a test.
fn left(tokens: &[Token<'_>], operator: usize) -> Option<usize> {
    let last = operator.checked_sub(1)?;
    let mut first = last;
    loop {
        let token = tokens.get(first)?;
        let before = first.checked_sub(1).and_then(|at| tokens.get(at));
        match (token.kind, token.text) {
            (TokenKind::Mark, ")" | "]" | "}") => {
                first = opening(tokens, first)?;
                let is_called = first.checked_sub(1).and_then(|at| tokens.get(at)).is_some_and(ends_value);
                if !is_called {
                    break;
                }
                first -= 1;
            }
            (TokenKind::Word, word) if KEYWORDS.contains(&word) => return None,
            (TokenKind::Word | TokenKind::Number, _) if before.is_some_and(|mark| matches!(mark.text, "." | "|")) => {
                first = first.checked_sub(2)?;
            }
            (TokenKind::Word, _) => break,
            (TokenKind::Number | TokenKind::Text, _) if first == last => return None,
            (TokenKind::Number | TokenKind::Text, _) => break,
            _ => return None,
        }
    }
    let is_test = (1..=3)
        .any(|back| first.checked_sub(back).and_then(|at| tokens.get(at)).is_some_and(|token| token.text == "is"));
    if is_test { None } else { tokens.get(last).map(Token::end) }
}

/// The end of the operand behind an operator; nothing where it is a literal.
fn right(tokens: &[Token<'_>], operator: usize) -> Option<usize> {
    let first = (operator + 1..tokens.len()).find(|at| tokens[*at].text != "-")?;
    let mut last = match (tokens[first].kind, tokens[first].text) {
        (TokenKind::Mark, "(" | "[" | "{") => closing(tokens, first)?,
        (TokenKind::Mark, _) => return None,
        (TokenKind::Word, word) if KEYWORDS.contains(&word) => return None,
        _ => first,
    };
    loop {
        let next = tokens.get(last + 1);
        match next.map(|token| (token.kind, token.text)) {
            Some((TokenKind::Mark, "(" | "[")) => last = closing(tokens, last + 1)?,
            Some((TokenKind::Mark, "." | "|")) => last += 2,
            Some((TokenKind::Text, _)) if tokens[last].kind == TokenKind::Text => last += 1,
            _ => break,
        }
    }
    let is_literal = last == first && matches!(tokens[first].kind, TokenKind::Number | TokenKind::Text);
    if is_literal { None } else { tokens.get(last).map(Token::end) }
}

/// Whether a bracket behind this token calls or indexes it.
fn ends_value(token: &Token<'_>) -> bool {
    match token.kind {
        TokenKind::Word => !KEYWORDS.contains(&token.text),
        TokenKind::Number => false,
        TokenKind::Text => true,
        TokenKind::Mark => matches!(token.text, ")" | "]" | "}"),
    }
}

fn depth(token: &Token<'_>) -> isize {
    match (token.kind, token.text) {
        (TokenKind::Mark, "(" | "[" | "{") => 1,
        (TokenKind::Mark, ")" | "]" | "}") => -1,
        _ => 0,
    }
}

/// The bracket that closes the one at a place.
fn closing(tokens: &[Token<'_>], open: usize) -> Option<usize> {
    let mut level = 0;
    (open..tokens.len()).find(|at| {
        level += depth(&tokens[*at]);
        level == 0
    })
}

/// The bracket that the one at a place closes.
fn opening(tokens: &[Token<'_>], close: usize) -> Option<usize> {
    let mut level = 0;
    (0..=close).rev().find(|at| {
        level += depth(&tokens[*at]);
        level == 0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn added(code: &str) -> String {
        let (mut text, mut done) = (String::new(), 0);
        for (at, filter) in operands(code) {
            text.push_str(&code[done..at]);
            text.push_str(&filter.replace("written", "w").replace("sized", "s"));
            done = at;
        }
        text + &code[done..]
    }

    #[test]
    fn operands_get_filters_that_bound_their_sizes() {
        for (code, wanted) in [
            ("a ~ b", "a|_w ~ b|_w"),
            ("'x' ~ r.name ~ '-' ~ f(r[0], a + 1)|trim(2)", "'x' ~ r.name|_w ~ '-' ~ f(r[0], a|_s + 1)|trim(2)|_w"),
            ("{% set ns.x = ns.x ~ ns.x %}", "{% set ns.x = ns.x|_w ~ ns.x|_w %}"),
            ("(ns.x + ns.x)|list", "(ns.x|_s + ns.x|_s)|list"),
            ("a + -b * c ~ 'd' 'e'", "a|_s + -b|_s * c|_w ~ 'd' 'e'|_w"),
            ("x is defined ~ y", "x is defined ~ y|_w"),
            ("x is not divisibleby(3) + 1", "x is not divisibleby(3) + 1"),
            ("a if (b) + c else not d", "a if (b)|_s + c|_s else not d"),
            ("[1] + [2, 'a~b']", "[1]|_s + [2, 'a~b']|_s"),
            ("{%+ if a +%}", "{%+ if a +%}"),
            ("1 + 2.5 ~ '~'", "1 + 2.5 ~ '~'"),
        ] {
            assert_eq!(added(code), wanted);
        }
        for wrong in ["~", "a ~", "~ )", "(+", "a.~b", "a|+", ") + (", "not ~ is"] {
            let _ = added(wrong);
        }
    }
}
