//! Whether two texts say the same in the same order, for a reader that does not tell letter cases apart.
//!
//! Such a reader takes a list in which a type is named once for one that names it for each object. White space and brackets
//! part its words, and a `;` comment ends at the line's end. It may take `\n` alone for that, where rmem takes `\r` as well:
//! so a text with a `\r` that no `\n` follows is like no other.

use crate::formats::pddl::{Token, Tokens};

/// Whether two texts have the same brackets and words, but for letter case and for how often a type is named in a row:
/// `a - t b - t` is `a b - t`.
pub(super) fn is_alike(one: &str, other: &str) -> bool {
    if has_lone_return(one) || has_lone_return(other) {
        return false;
    }
    let (mut left, mut right) = (Words::new(one), Words::new(other));
    loop {
        match (left.next(), right.next()) {
            (None, None) => break,
            (Some(left), Some(right)) if left.eq_ignore_ascii_case(right) => {}
            _ => return false,
        }
    }
    let is_same =
        |((one, to), (other, end)): (&(&str, usize), &(&str, usize))| to == end && one.eq_ignore_ascii_case(other);
    left.types.len() == right.types.len() && left.types.iter().zip(&right.types).all(is_same)
}

/// Whether a text has a `\r` that no `\n` follows.
fn has_lone_return(text: &str) -> bool {
    text.match_indices('\r').any(|(at, _)| text.as_bytes().get(at + 1) != Some(&b'\n'))
}

/// The brackets and words of a text, but for the types behind dashes.
struct Words<'t> {
    text: &'t str,
    tokens: Tokens<'t>,
    /// How many there were so far.
    count: usize,
    /// The types, each with the count where what has it ends.
    types: Vec<(&'t str, usize)>,
    /// Whether the last type is one of the list that is open, so that it may be named again.
    is_in_list: bool,
}

impl<'t> Words<'t> {
    fn new(text: &'t str) -> Self {
        Self { text, tokens: Tokens::new(text, 0), count: 0, types: Vec::new(), is_in_list: false }
    }

    /// The type that is named, behind a dash.
    fn named(&mut self) -> Option<&'t str> {
        let mut ahead = self.tokens.clone();
        let Some(Token::Word(span)) = ahead.next_token() else { return None };
        self.tokens = ahead;
        self.text.get(span.start..span.end)
    }
}

impl<'t> Iterator for Words<'t> {
    type Item = &'t str;

    fn next(&mut self) -> Option<&'t str> {
        loop {
            let word = match self.tokens.next_token()? {
                Token::Open(at) | Token::Close(at) => {
                    self.is_in_list = false;
                    self.text.get(at..=at)?
                }
                Token::Word(span) => self.text.get(span.start..span.end)?,
            };
            let Some(named) = (word == "-").then(|| self.named()).flatten() else {
                self.count += 1;
                return Some(word);
            };
            match self.types.last_mut() {
                Some((known, end)) if self.is_in_list && known.eq_ignore_ascii_case(named) => *end = self.count,
                _ => self.types.push((named, self.count)),
            }
            self.is_in_list = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_may_be_named_once_or_for_each() {
        assert!(is_alike("(t - a l - b m - b n - c)", "(t - a l m - b n - c)"));
        assert!(is_alike("(a - t b - T c - u)", "(A B - t ; of two\n c - u)"));
        for other in
            ["(a b c - t)", "(a - t b c - u)", "(a b - t c)", "(a b - t (c - u))", "(a b - t c - u", "(b a - t c - u)"]
        {
            assert!(!is_alike("(a - t b - t c - u)", other), "{other}");
        }
        assert!(is_alike("(- x y)", "(- X Y)") && !is_alike("(- x y)", "(y - x)") && !is_alike("(- x y)", "(- y x)"));
        assert!(is_alike("(a - (either t u))", "(a - (either T U))") && !is_alike("(-)", "()"));
    }

    #[test]
    fn a_line_that_may_not_end_for_every_reader_is_like_no_other() {
        assert!(is_alike("(a b)", "(a ; of two\r\n b)\r\n"));
        for other in ["(a ; of two\r b)", "(a b)\r", "(a\rb)", "(a ; of two\r\r\n b)"] {
            assert!(!is_alike("(a b)", other), "{other:?}");
            assert!(!is_alike(other, "(a b)"), "{other:?}");
        }
    }
}
