//! Rendered text, in which numbers in brackets stand for values and places.

use super::value::{CLOSE, OPEN};

/// The byte that the brackets begin with, which texts seldom have.
const FIRST: u8 = 0xEF;

/// Whether there may be brackets in a text, or parts of them.
pub(super) fn may_be_marked(text: &str) -> bool {
    memchr::memchr(FIRST, text.as_bytes()).is_some()
}

/// Whether there may be the number of a value in a text.
pub(super) fn is_marked(text: &str) -> bool {
    may_be_marked(text) && text.contains(OPEN)
}

/// Whether a filter cut a text that was rendered in the middle of a mark.
pub(super) fn is_cut(text: &str) -> bool {
    if !may_be_marked(text) {
        return false;
    }
    let mut is_open = false;
    for mark in text.chars().filter(|c| [OPEN, CLOSE].contains(c)) {
        if is_open == (mark == OPEN) {
            return true;
        }
        is_open = !is_open;
    }
    is_open
}

/// A part of rendered text.
pub(super) enum Piece<'a> {
    Text(&'a str),
    /// The number of a value.
    Value(usize),
    /// The number of the fixed text that begins here.
    Mark(usize),
    /// The number of the place that wrote what follows, up to its end.
    Begin(usize),
    End,
}

/// Text that the expression or filter of a numbered place wrote.
pub(super) fn bracketed(site: usize, text: &str) -> String {
    format!("{OPEN}+{site}{CLOSE}{text}{OPEN}/{CLOSE}")
}

/// Takes rendered text apart.
pub(super) fn pieces(text: &str) -> impl Iterator<Item = Piece<'_>> {
    let mut rest = text;
    std::iter::from_fn(move || {
        if let Some(after) = rest.strip_prefix(OPEN) {
            let (number, after) = after.split_once(CLOSE).unwrap_or((after, ""));
            rest = after;
            let parse = |number: &str| number.parse().unwrap_or(usize::MAX);
            return Some(match number.split_at_checked(1) {
                Some(("-", number)) => Piece::Mark(parse(number)),
                Some(("+", number)) => Piece::Begin(parse(number)),
                Some(("/", "")) => Piece::End,
                _ => Piece::Value(parse(number)),
            });
        }
        let end = rest.find(OPEN).unwrap_or(rest.len());
        let (piece, after) = rest.split_at(end);
        rest = after;
        (!piece.is_empty()).then_some(Piece::Text(piece))
    })
}
