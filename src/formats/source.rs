//! Texts with names, and stretches of them.

use std::sync::Arc;

/// A line and a column, both from 1.
pub type Position = (usize, usize);

/// A text and the name it goes by in messages: a path, `<stdin>`, `<argument>`.
///
/// Cloning is cheap; the text is shared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    pub(super) name: Arc<str>,
    text: Arc<str>,
    first_line: usize,
    first_column: usize,
}

impl Source {
    /// Names `text`.
    pub fn new(name: impl Into<Arc<str>>, text: impl Into<Arc<str>>) -> Self {
        Self::starting_at(name, text, 1)
    }

    /// Names `text`, a part of a longer one, whose first line is number `first_line` there.
    pub fn starting_at(name: impl Into<Arc<str>>, text: impl Into<Arc<str>>, first_line: usize) -> Self {
        Self { name: name.into(), text: text.into(), first_line, first_column: 1 }
    }

    /// The same text, where it begins in the column `first_column` of its first line.
    #[must_use]
    pub fn in_column(self, first_column: usize) -> Self {
        Self { first_column, ..self }
    }

    /// The same text without the mark of its byte order, with which some editors begin a file.
    #[must_use]
    pub fn without_mark(self) -> Self {
        match self.text.strip_prefix('\u{feff}') {
            Some(text) => Self { text: text.into(), ..self },
            None => self,
        }
    }

    /// The name messages use.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The whole text.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The text that `span` covers; empty where the span lies outside the text.
    #[must_use]
    pub fn slice(&self, span: Span) -> &str {
        self.text.get(span.start..span.end).unwrap_or_default()
    }

    /// Line and column of a byte offset, both from 1, the column in characters.
    #[must_use]
    pub fn position(&self, offset: usize) -> Position {
        let mut offset = offset.min(self.text.len());
        while !self.text.is_char_boundary(offset) {
            offset -= 1;
        }
        let before = &self.text[..offset];
        let line = memchr::memchr_iter(b'\n', before.as_bytes()).count() + self.first_line;
        match before.rfind('\n') {
            Some(newline) => (line, before[newline + 1..].chars().count() + 1),
            None => (line, before.chars().count() + self.first_column),
        }
    }
}

/// A stretch of a text, as byte offsets; `end` is exclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, PartialOrd, Ord)]
pub struct Span {
    /// The first byte.
    pub start: usize,
    /// One past the last byte.
    pub end: usize,
}

impl Span {
    /// The span from `start` up to `end`.
    #[must_use]
    pub const fn new(start: usize, end: usize) -> Self {
        Self { start, end }
    }

    /// The empty span at `offset`.
    #[must_use]
    pub const fn at(offset: usize) -> Self {
        Self { start: offset, end: offset }
    }

    /// The smallest span that covers both.
    #[must_use]
    pub fn to(self, other: Self) -> Self {
        Self { start: self.start.min(other.start), end: self.end.max(other.end) }
    }
}
