//! Complaints about a place in a text: `path:line:column`, the line, a caret.
//!
//! Rendered here, because annotate-snippets puts the place below the message and not before it, where editors look for it.

use std::fmt;
use std::string::FromUtf8Error;
use std::sync::Arc;

use unicode_width::UnicodeWidthChar as _;

use super::command_line::word;
use super::source::{Position, Source, Span};
use crate::fault::{AtFault, Fault};

/// The most characters of a source line that a message repeats.
const LINE_WINDOW: usize = 100;

/// A complaint about one place of one text.
///
/// Its `Display` is what a user sees:
///
/// ```text
/// problem.pddl:3:10: expected `)`, found `:init`
///   |
/// 3 |   (:init (at r2 k)
///   |    ^^^^^
///   = hint: the list opened at 2:3 is not closed
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    inner: Box<Inner>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Inner {
    name: Arc<str>,
    line: usize,
    column: usize,
    span: Span,
    excerpt: Option<Excerpt>,
    message: String,
    hints: Vec<String>,
    kind: Kind,
}

/// What a complaint is about, where callers tell it from others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Mistake,
    /// The text is right, but uses what rmem cannot handle.
    Unsupported,
    /// The text names something that is not there.
    Missing,
    /// The text, or something in it, has no end.
    Unterminated,
}

/// The part of the source line that is shown, and where the carets go below it: in columns of a terminal.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Excerpt {
    text: String,
    offset: usize,
    width: usize,
}

impl Diagnostic {
    /// Complains about `span` of `source`. The message is a lower-case fragment
    /// without a full stop, saying what was expected and what was found.
    #[must_use]
    pub fn new(source: &Source, span: Span, message: impl Into<String>) -> Self {
        let (line, column) = source.position(span.start);
        Self {
            inner: Box::new(Inner {
                name: source.name.clone(),
                line,
                column,
                span,
                excerpt: Some(Excerpt::of(source.text(), span)),
                message: message.into(),
                hints: Vec::new(),
                kind: Kind::Mistake,
            }),
        }
    }

    /// Complains about a place whose text is not at hand.
    #[must_use]
    pub fn at(name: &str, line: usize, column: usize, message: impl Into<String>) -> Self {
        Self {
            inner: Box::new(Inner {
                name: name.into(),
                line,
                column,
                span: Span::default(),
                excerpt: None,
                message: message.into(),
                hints: Vec::new(),
                kind: Kind::Mistake,
            }),
        }
    }

    /// Complains about the first byte of a text that is not UTF-8; the text begins at a line and a column of `name`.
    #[must_use]
    pub(crate) fn not_utf8(name: &str, error: &FromUtf8Error, (first_line, first_column): Position) -> Self {
        let (bytes, start) = (error.as_bytes(), error.utf8_error().valid_up_to());
        let behind = bytes.get(start..).unwrap_or_default();
        let end = start + memchr::memchr(b'\n', behind).unwrap_or(behind.len());
        // What is in front of the byte is UTF-8, so that its offset stays.
        let shown = String::from_utf8_lossy(bytes.get(..end).unwrap_or_default());
        let source = Source::starting_at(name, shown, first_line).in_column(first_column);
        Self::new(&source, Span::at(start), "expected UTF-8 text, found invalid UTF-8").hint(conversion(name, bytes))
    }

    /// Adds a line that says what to do.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.inner.hints.push(hint.into());
        self
    }

    /// Removes what to do, where more is known of it than the reader of the text knew.
    #[must_use]
    pub fn without_hints(mut self) -> Self {
        self.inner.hints.clear();
        self
    }

    /// Says that the text is right, but uses what rmem cannot handle.
    #[must_use]
    pub fn unsupported(mut self) -> Self {
        self.inner.kind = Kind::Unsupported;
        self
    }

    /// Whether the text uses what rmem cannot handle.
    #[must_use]
    pub fn is_unsupported(&self) -> bool {
        self.inner.kind == Kind::Unsupported
    }

    /// Says that the text names something that is not there.
    #[must_use]
    pub fn missing(mut self) -> Self {
        self.inner.kind = Kind::Missing;
        self
    }

    /// Whether the text names something that is not there.
    #[must_use]
    pub fn is_missing(&self) -> bool {
        self.inner.kind == Kind::Missing
    }

    /// Says that the text, or something in it, has no end.
    #[must_use]
    pub fn unterminated(mut self) -> Self {
        self.inner.kind = Kind::Unterminated;
        self
    }

    /// Whether the text, or something in it, has no end.
    #[must_use]
    pub fn is_unterminated(&self) -> bool {
        self.inner.kind == Kind::Unterminated
    }

    /// Says the same of the text as another complaint.
    #[must_use]
    pub fn of_kind(mut self, other: &Self) -> Self {
        self.inner.kind = other.inner.kind;
        self
    }

    /// What to do, line by line.
    #[must_use]
    pub fn hints(&self) -> &[String] {
        &self.inner.hints
    }

    /// The message without its place.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.inner.message
    }

    /// The name of the text complained about.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Line and column, both from 1.
    #[must_use]
    pub fn position(&self) -> (usize, usize) {
        (self.inner.line, self.inner.column)
    }

    /// The line as it is shown, where it is; of a long one, the part around the place.
    #[must_use]
    pub fn excerpt(&self) -> Option<&str> {
        self.inner.excerpt.as_ref().map(|excerpt| excerpt.text.as_str())
    }

    /// The stretch complained about, in the text it was made from.
    #[must_use]
    pub fn span(&self) -> Span {
        self.inner.span
    }

    /// What pest says, in the user's words: `rename` gives a rule its name in messages.
    pub(crate) fn from_pest<R: pest::RuleType>(
        source: &Source,
        error: &pest::error::Error<R>,
        rename: impl Fn(&R) -> String,
    ) -> Self {
        Self::from_pest_at(source, 0, error, rename)
    }

    /// The same for a parse of the part of `source` that begins at byte `base`.
    pub(crate) fn from_pest_at<R: pest::RuleType>(
        source: &Source,
        base: usize,
        error: &pest::error::Error<R>,
        rename: impl Fn(&R) -> String,
    ) -> Self {
        use pest::error::{ErrorVariant, InputLocation};
        let span = match error.location {
            InputLocation::Pos(offset) => Span::at(base + offset),
            InputLocation::Span((start, end)) => Span::new(base + start, base + end),
        };
        let message = match &error.variant {
            ErrorVariant::CustomError { message } => return Self::new(source, span, message.clone()),
            ErrorVariant::ParsingError { positives, negatives: _ } => {
                let mut wanted: Vec<String> = positives.iter().map(rename).collect();
                wanted.sort();
                wanted.dedup();
                format!("expected {}, found {}", either(&wanted), found(source.text(), span.start))
            }
        };
        let diagnostic = Self::new(source, span, message);
        if span.start < source.text().len() { diagnostic } else { diagnostic.unterminated() }
    }
}

/// How a file that is not UTF-8 is made one that is.
fn conversion(name: &str, bytes: &[u8]) -> String {
    let file = if name.starts_with('<') { "FILE".to_owned() } else { word(name) };
    match bytes {
        [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] => format!("this is UTF-16: convert it by iconv -f utf-16 -t utf-8 {file}"),
        _ if bytes.contains(&0) => "this is a binary file, not a text".to_owned(),
        _ => format!("if this is Latin-1, convert it by iconv -f latin1 -t utf-8 {file}"),
    }
}

/// `a`, `a or b`, `a, b, or c`.
fn either(words: &[String]) -> String {
    match words {
        [] => "something else".to_owned(),
        [only] => only.clone(),
        [first, second] => format!("{first} or {second}"),
        [init @ .., last] => format!("{}, or {last}", init.join(", ")),
    }
}

/// The word at `offset`, for `found …`.
fn found(text: &str, offset: usize) -> String {
    let rest = text.get(offset..).unwrap_or_default();
    let Some(first) = rest.chars().next() else { return "the end of the text".to_owned() };
    if first == '\n' || first == '\r' {
        return "the end of the line".to_owned();
    }
    let word: String = if first.is_alphanumeric() || "?:_-".contains(first) {
        rest.chars().take_while(|c| c.is_alphanumeric() || "?:_-.".contains(*c)).take(24).collect()
    } else {
        first.to_string()
    };
    format!("`{}`", word.escape_debug())
}

impl Excerpt {
    fn of(text: &str, span: Span) -> Self {
        let mut start = span.start.min(text.len());
        while !text.is_char_boundary(start) {
            start -= 1;
        }
        let line_start = text[..start].rfind('\n').map_or(0, |newline| newline + 1);
        let line_end =
            memchr::memchr2(b'\n', b'\r', &text.as_bytes()[start..]).map_or(text.len(), |length| start + length);
        let before = text[line_start..start].chars().count();
        let mut end = span.end.clamp(start, line_end);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let marked = text[start..end].chars().count().max(1);
        let skipped = before.saturating_sub(LINE_WINDOW * 2 / 3);
        let shown: String = text[line_start..line_end]
            .chars()
            .skip(skipped)
            .take(LINE_WINDOW)
            .map(|c| if c.is_control() { ' ' } else { c })
            .collect();
        let cut_left = skipped > 0;
        let offset = before - skipped;
        let text = if cut_left { format!("…{shown}") } else { shown };
        let (offset, width) = (offset + usize::from(cut_left), marked.min(LINE_WINDOW.saturating_sub(offset).max(1)));
        let columns = |from, count| columns(text.chars().skip(from), count);
        let (offset, width) = (columns(0, offset), columns(offset, width).max(1));
        Self { text, offset, width }
    }
}

/// How many columns of a terminal so many characters take; one for each where there are no more.
fn columns(mut characters: impl Iterator<Item = char>, count: usize) -> usize {
    (0..count).map(|_| characters.next().map_or(1, |c| c.width().unwrap_or(0))).sum()
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inner { name, line, column, excerpt, message, hints, .. } = &*self.inner;
        write!(f, "{name}:{line}:{column}: {message}")?;
        let margin = " ".repeat(line.to_string().len());
        if let Some(Excerpt { text, offset, width }) = excerpt {
            write!(f, "\n{margin} |\n{line} | {}", text.trim_end())?;
            write!(f, "\n{margin} | {}{}", " ".repeat(*offset), "^".repeat(*width))?;
        }
        for hint in hints {
            write!(f, "\n{margin} = hint: {hint}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Diagnostic {}

impl AtFault for Diagnostic {
    fn fault(&self) -> Fault {
        if self.is_unsupported() { Fault::Unsupported } else { Fault::Input }
    }
}

/// Several complaints at once, shown one after another.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostics(pub Vec<Diagnostic>);

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, diagnostic) in self.0.iter().enumerate() {
            let gap = if index == 0 { "" } else { "\n\n" };
            write!(f, "{gap}{diagnostic}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Diagnostics {}

impl AtFault for Diagnostics {
    fn fault(&self) -> Fault {
        if self.0.iter().any(Diagnostic::is_unsupported) { Fault::Unsupported } else { Fault::Input }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_caret_stands_below_its_place_behind_wide_and_combining_characters() {
        for (text, carets) in [("日本語😀é, b: ", 14), ("e\u{301}e, b: ", 7), ("ab, b: ", 7)] {
            let place = Span::at(text.len());
            let shown = Diagnostic::new(&Source::new("q", text), place, "expected a value").to_string();
            assert!(shown.ends_with(&format!("\n  | {}^", " ".repeat(carets))), "{shown}");
        }
        let shown = Diagnostic::new(&Source::new("q", "{a: 日本}"), Span::new(4, 10), "unknown").to_string();
        assert!(shown.ends_with("\n  |     ^^^^"), "{shown}");
    }

    #[test]
    fn shows_the_line_and_a_caret_under_the_span() {
        let source = Source::new("p.pddl", "(define\n  (:init (at r2 k)\n");
        let text = Diagnostic::new(&source, Span::new(11, 16), "expected `)`").hint("close it").to_string();
        assert_eq!(text, "p.pddl:2:4: expected `)`\n  |\n2 |   (:init (at r2 k)\n  |    ^^^^^\n  = hint: close it");
    }

    #[test]
    fn counts_columns_in_characters() {
        let source = Source::new("x", "äöü!");
        assert_eq!(source.position(6), (1, 4));
        let text = Diagnostic::new(&source, Span::at(6), "expected `.`").to_string();
        assert!(text.ends_with("1 | äöü!\n  |    ^"), "{text}");
    }

    #[test]
    fn repeats_only_a_window_of_a_long_line() {
        let line = "a".repeat(10_000);
        let source = Source::new("x", line);
        let text = Diagnostic::new(&source, Span::new(5_000, 6_000), "no").to_string();
        assert!(text.len() < 500, "{}", text.len());
    }

    #[test]
    fn survives_spans_outside_the_text() {
        let source = Source::new("x", "é");
        for (start, end) in [(1, 1), (9, 12), (0, 99), (2, 0)] {
            let _ = Diagnostic::new(&source, Span::new(start, end), "no").to_string();
        }
    }
}
