//! Values as PDDL names, and back.
//!
//! A legal name is a letter followed by letters, digits, `-` and `_`. It stays
//! as it is, unless it is an operator (`not`, `and`, …). Any other text is written as `x--BODY--x`, where lower-case letters
//! and digits stand for themselves and every other byte of the UTF-8 text is
//! `_` and two hexadecimal digits: `Box 1` is `x--_42ox_201--x`. So the mangled
//! name is legal, survives planners that fold case, and needs no table to be
//! read back. A legal name that contains `x--` is mangled too, so that nothing
//! is restored that was never mangled.
//!
//! A value in a larger token (`O<<id>>`, `<<name>>-I`) stays as it is where the
//! whole token is a legal name; else only the value's part is mangled, and
//! [`restore`] decodes every such part of a token.

use std::fmt::Write as _;

const OPEN: &str = "x--";
const CLOSE: &str = "--x";

/// Whether PDDL takes the text as a name.
#[must_use]
pub fn is_legal(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic()) && is_inner(text)
}

/// Whether the text can stand inside of a name.
pub(super) fn is_inner(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_')
}

/// Whether the text might be taken for a mangled name, in any case of letters.
pub(super) fn looks_mangled(text: &str) -> bool {
    text.as_bytes().windows(OPEN.len()).any(|window| matches!(window, [b'x' | b'X', b'-', b'-']))
}

/// The words that make an expression of what follows, wherever a name could stand.
const OPERATORS: [&str; 9] = ["and", "or", "not", "imply", "forall", "exists", "when", "either", "define"];

/// Whether PDDL would take the name for an operator.
pub(super) fn is_operator(text: &str) -> bool {
    OPERATORS.iter().any(|operator| operator.eq_ignore_ascii_case(text))
}

/// The name that stands for `text`; the text itself if it is a legal name.
#[must_use]
pub fn mangle(text: &str) -> String {
    if is_legal(text) && !looks_mangled(text) && !is_operator(text) { text.to_owned() } else { encode(text) }
}

/// The mangled form, whatever the text is.
pub(super) fn encode(text: &str) -> String {
    let mut name = String::with_capacity(text.len() + OPEN.len() + CLOSE.len());
    name.push_str(OPEN);
    for byte in text.bytes() {
        if byte.is_ascii_lowercase() || byte.is_ascii_digit() {
            name.push(char::from(byte));
        } else {
            let _ = write!(name, "_{byte:02x}");
        }
    }
    name.push_str(CLOSE);
    name
}

/// The text that a name stands for, in whatever case a planner gives it.
///
/// What is not mangled comes back unchanged; the case of a legal name that a
/// planner folded is not known here.
#[must_use]
pub fn restore(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    let mut rest = name;
    while let Some(first) = rest.chars().next() {
        if let Some((decoded, after)) = decode(rest) {
            text.push_str(&decoded);
            rest = after;
        } else {
            text.push(first);
            rest = &rest[first.len_utf8()..];
        }
    }
    text
}

/// An expression, or a message with names in it, in the memory's spelling: each name as it can be written in an expression and
/// read back by [`spell`]. Between backticks of a message it stays without quotes.
#[must_use]
pub fn readable(text: &str) -> String {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    let mut readable = String::with_capacity(text.len());
    let (mut rest, mut before) = (text, ' ');
    while let Some(first) = rest.chars().next() {
        let length = rest.find(|c: char| !is_name(c)).unwrap_or(rest.len()).max(first.len_utf8());
        let (token, after) = rest.split_at(length);
        let restored = if is_name(first) { restore(token) } else { token.to_owned() };
        match restored == token || before == '`' {
            true => readable.push_str(&restored),
            false => readable.push_str(&written(&restored)),
        }
        before = token.chars().next_back().unwrap_or(' ');
        rest = after;
    }
    readable
}

/// A text of the memory as it is written in an expression: in quotes where it has blanks, brackets or quotes, or where
/// PDDL would take it for an operator, a variable, a keyword, a number, or a name that stands for another text.
#[must_use]
pub fn written(text: &str) -> String {
    let is_special = |c: char| c.is_whitespace() || c.is_control() || "()\";\\".contains(c);
    match text.is_empty() || text.contains(is_special) || (is_syntax(text) && mangle(text) != text) {
        true => quoted(text),
        false => text.to_owned(),
    }
}

/// A text in quotes, on one line.
fn quoted(text: &str) -> String {
    let mut quoted = String::from('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            '\n' => quoted.push_str("\\n"),
            '\r' => quoted.push_str("\\r"),
            '\t' => quoted.push_str("\\t"),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

/// Writes an expression in names of PDDL: names may be given as the memory has them, in quotes where they have
/// blanks or brackets, like `(on "box #18" box#17)`. Comments stay.
#[must_use]
pub fn spell(expression: &str) -> String {
    tokens(expression).map(|(_, token)| spell_token(token)).collect()
}

/// The tokens of an expression, each with its offset: a delimiter, a quoted text, a comment, or a word.
pub(super) fn tokens(expression: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut offset = 0;
    std::iter::from_fn(move || {
        let rest = expression.get(offset..).filter(|rest| !rest.is_empty())?;
        let start = offset;
        offset += token_length(rest);
        Some((start, expression.get(start..offset)?))
    })
}

/// A token of an expression in names of PDDL.
pub(super) fn spell_token(token: &str) -> String {
    match token.chars().next() {
        Some('"') => mangle(&unquoted(token)),
        Some(first) if first == ';' || is_delimiter(first) || is_syntax(token) => token.to_owned(),
        _ => mangle(token),
    }
}

/// Writes a plan in names of PDDL: on each line, what is in brackets is spelled as by [`spell`].
#[must_use]
pub fn spell_plan(text: &str) -> String {
    let action = |line: &str| {
        let (start, end) = (line.find('(')?, line.rfind(')')? + 1);
        let (before, action, after) = (line.get(..start)?, line.get(start..end)?, line.get(end..)?);
        (!before.contains(';')).then(|| format!("{before}{}{after}", spell(action)))
    };
    text.split_inclusive('\n').map(|line| action(line).unwrap_or_else(|| line.to_owned())).collect()
}

fn is_delimiter(c: char) -> bool {
    c.is_whitespace() || c.is_control() || "()\";".contains(c)
}

/// The length of the token that a text starts with, in bytes: a delimiter, a quoted text, a comment, or a word.
fn token_length(text: &str) -> usize {
    let first = text.chars().next().map_or(0, char::len_utf8);
    let until = |end: Option<usize>| end.unwrap_or(text.len());
    match text.as_bytes().first() {
        Some(b';') => until(text.find('\n')),
        Some(b'"') => {
            let mut is_escaped = false;
            let end = text.char_indices().skip(1).find(|(_, c)| {
                let is_end = *c == '"' && !is_escaped;
                is_escaped = *c == '\\' && !is_escaped;
                is_end
            });
            until(end.map(|(at, _)| at + 1))
        }
        _ if text.starts_with(is_delimiter) => first,
        _ => until(text.find(is_delimiter)),
    }
}

/// Whether a token is a quoted text that is not closed.
pub(super) fn is_open(token: &str) -> bool {
    let Some(inner) = token.strip_prefix('"') else { return false };
    let Some(inner) = inner.strip_suffix('"') else { return true };
    // The last quote closes nothing where an odd number of backslashes stands before it.
    let backslashes = inner.len() - inner.trim_end_matches('\\').len();
    backslashes % 2 == 1
}

/// The text between quotes.
fn unquoted(token: &str) -> String {
    let inner = token.strip_prefix('"').unwrap_or(token);
    let inner = inner.strip_suffix('"').unwrap_or(inner);
    let (mut text, mut is_escaped) = (String::with_capacity(inner.len()), false);
    for c in inner.chars() {
        let c = match c {
            'n' if is_escaped => '\n',
            'r' if is_escaped => '\r',
            't' if is_escaped => '\t',
            c => c,
        };
        is_escaped = c == '\\' && !is_escaped;
        if !is_escaped {
            text.push(c);
        }
    }
    text
}

/// Whether a word is PDDL as it is: a name, a number, a variable, a keyword or an operator.
fn is_syntax(word: &str) -> bool {
    let is_marked = |word: &str| word.strip_prefix(['?', ':']).is_some_and(is_inner);
    let is_operator = ["=", "<", ">", "<=", ">=", "+", "-", "*", "/"].contains(&word);
    is_legal(word) || is_number(word) || is_marked(word) || is_operator
}

fn is_number(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) && word.parse::<f64>().is_ok()
}

/// Decodes the mangled part that `text` starts with; returns what follows as well.
fn decode(text: &str) -> Option<(String, &str)> {
    let body = text.get(OPEN.len()..).filter(|_| text[..OPEN.len()].eq_ignore_ascii_case(OPEN))?;
    let length = body.find('-')?;
    let after = body.get(length..)?;
    after.get(..CLOSE.len()).filter(|end| end.eq_ignore_ascii_case(CLOSE))?;
    let mut bytes = Vec::with_capacity(length);
    let mut rest = &body[..length];
    while let Some(first) = rest.bytes().next() {
        let width = match first {
            b'_' => {
                let digits = rest.get(1..3).filter(|digits| digits.bytes().all(|b| b.is_ascii_hexdigit()))?;
                bytes.push(u8::from_str_radix(digits, 16).ok()?);
                3
            }
            _ if first.is_ascii_alphanumeric() => {
                bytes.push(first.to_ascii_lowercase());
                1
            }
            _ => return None,
        };
        rest = rest.get(width..)?;
    }
    Some((String::from_utf8(bytes).ok()?, after.get(CLOSE.len()..)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_expression_may_have_the_memorys_names() {
        assert_eq!(spell("(box-on box#18 packing)"), format!("(box-on {} packing)", mangle("box#18")));
        assert_eq!(spell("(on \"box \\\"(1)\" B) ; a#b"), format!("(on {} B) ; a#b", mangle("box \"(1)")));
        let syntax = "(and (>= (fuel ?x) -2.5) (forall (?y - block) (not (= ?y x--_31--x))))";
        assert_eq!(spell(syntax), syntax);
        for text in ["", "\"", "\"\\", ";", "ä(", "\u{0}#"] {
            let _ = spell(text);
        }
    }

    #[test]
    fn a_readable_expression_is_spelled_back() {
        let expression = format!("(on {} {}) ", mangle("box #18"), mangle("box#17"));
        assert_eq!(readable(&expression), "(on \"box #18\" box#17) ");
        assert_eq!(spell(&readable(&expression)), expression);
        let message = format!("(go {}): object `{}` is unknown, {}.", mangle("ä"), mangle("box #18"), mangle("a b"));
        assert_eq!(readable(&message), "(go ä): object `box #18` is unknown, \"a b\".");
        let number = format!("(at {})", mangle("3"));
        assert_eq!(spell(&readable(&number)), number);
    }

    #[test]
    fn a_name_that_pddl_would_read_otherwise_is_in_quotes() {
        for name in ["*", "+", "-", "/", "=", "<", ">=", "?x", ":a", "x--a--x", "not", "3", "-2.5", "?", ":"] {
            assert_eq!(written(name), format!("\"{name}\""));
            let step = format!("(put {} B)", mangle(name));
            assert_eq!(spell(&readable(&step)), step, "{name}");
        }
        assert_eq!([written("box#17"), written("A-1"), written("a?b")], ["box#17", "A-1", "a?b"]);
    }

    #[test]
    fn a_text_of_several_lines_is_written_on_one_and_read_back() {
        assert_eq!(written("two\nlines\t\"\\n\""), r#""two\nlines\t\"\\n\"""#);
        for text in ["two\nlines", "\\n", "a\\", "\r\t \"", "n"] {
            assert_eq!(spell(&written(text)), mangle(text), "{text:?}");
        }
    }

    #[test]
    fn legal_names_stay_and_others_say_what_they_stand_for() {
        for name in ["A", "on-table", "RING_BLUE", "a1"] {
            assert_eq!(mangle(name), name);
        }
        assert_eq!(mangle("Box 1"), "x--_42ox_201--x");
        assert_eq!(mangle("A) (on B"), "x--_41_29_20_28on_20_42--x");
        assert_eq!(mangle(""), "x----x");
        assert_eq!(mangle("1a"), "x--1a--x");
        assert_eq!(mangle("Not"), "x--_4eot--x");
        assert_eq!(mangle("X--a--X"), "x--_58_2d_2da_2d_2d_58--x");
    }

    #[test]
    fn parts_of_a_token_are_restored_where_they_stand() {
        assert_eq!(restore("Ox--1_20--x-I"), "O1 -I");
        assert_eq!(restore("BOXX--A_20--XX--B--X"), "BOXa b");
        for name in ["box--1", "x--", "x--_4--x", "x--_ff--x", "x--a-b--x", "é--x"] {
            assert_eq!(restore(name), name);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn any_text_becomes_a_legal_name_and_comes_back_in_any_case(text in any::<String>()) {
            let name = mangle(&text);
            prop_assert!(is_legal(&name));
            prop_assert_eq!(&restore(&name), &text);
            if name != text {
                prop_assert_eq!(restore(&name.to_ascii_uppercase()), text);
            }
        }

        #[test]
        fn any_text_that_is_written_is_read_back(text in any::<String>()) {
            prop_assert_eq!(spell(&written(&text)), mangle(&text));
        }

        #[test]
        fn texts_near_the_mangled_form_come_back_as_well(text in "[xX_a0-]{0,12}") {
            prop_assert_eq!(restore(&mangle(&text)), text);
        }
    }
}
