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
    text.as_bytes().windows(OPEN.len()).any(|window| window.eq_ignore_ascii_case(OPEN.as_bytes()))
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
        fn texts_near_the_mangled_form_come_back_as_well(text in "[xX_a0-]{0,12}") {
            prop_assert_eq!(restore(&mangle(&text)), text);
        }
    }
}
