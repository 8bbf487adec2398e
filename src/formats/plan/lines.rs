//! The lines of a text, and which of them are worth a parser's time.

use pest::error::{Error, ErrorVariant, InputLocation};

use crate::formats::{Diagnostic, Source, Span};

/// The longest line that can be a sentence of a planner, in bytes. Longer ones
/// are data that got onto the stream.
pub(super) const SENTENCE: usize = 1 << 16;

/// The byte order mark that some editors begin a file with.
pub(super) const MARK: char = '\u{feff}';

/// A line without its break.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line<'a> {
    /// From 1.
    pub(super) number: usize,
    /// Of its first byte in the text.
    pub(super) offset: usize,
    /// What it says.
    pub(super) text: &'a str,
}

/// The lines of `text`, broken at `\n`; a `\r` before it is left to the grammars, and a byte
/// order mark is not part of the first.
pub(super) fn lines(text: &str) -> impl Iterator<Item = Line<'_>> {
    let body = text.strip_prefix(MARK).unwrap_or(text);
    let mut offset = text.len() - body.len();
    body.split('\n').enumerate().map(move |(index, text)| {
        let line = Line { number: index + 1, offset, text };
        offset += text.len() + 1;
        line
    })
}

/// What pest says about a line, as a complaint about the text it is a line of.
pub(super) fn complain<R: pest::RuleType>(
    source: &Source,
    line: Line<'_>,
    error: &Error<R>,
    rename: impl Fn(&R) -> &'static str,
) -> Diagnostic {
    let column = match error.location {
        InputLocation::Pos(offset) | InputLocation::Span((offset, _)) => offset,
    };
    let rest = line.text.get(column..).unwrap_or_default();
    let wanted = match &error.variant {
        ErrorVariant::ParsingError { positives, .. } => {
            let mut wanted: Vec<&str> = positives.iter().map(rename).filter(|word| !word.is_empty()).collect();
            wanted.sort_unstable();
            wanted.dedup();
            either(&wanted)
        }
        ErrorVariant::CustomError { message } => message.clone(),
    };
    let word: String = rest.trim().chars().take_while(|c| !c.is_whitespace()).take(24).collect();
    let found = match word.is_empty() {
        true if line.offset + line.text.len() >= source.text().len() => "the end of the text".to_owned(),
        true => "the end of the line".to_owned(),
        false => format!("`{}`", word.escape_debug()),
    };
    let at = line.offset + column;
    Diagnostic::new(source, Span::new(at, at + word.len()), format!("expected {wanted}, found {found}"))
}

fn either(words: &[&str]) -> String {
    match words {
        [] => "a step".to_owned(),
        [only] => (*only).to_owned(),
        [init @ .., last] => format!("{} or {last}", init.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_know_their_place() {
        let all: Vec<_> = lines("a\n\nbc\n").map(|line| (line.number, line.offset, line.text)).collect();
        assert_eq!(all, [(1, 0, "a"), (2, 2, ""), (3, 3, "bc"), (4, 6, "")]);
        let all: Vec<_> = lines("\u{feff}a\nb").map(|line| (line.number, line.offset, line.text)).collect();
        assert_eq!(all, [(1, 3, "a"), (2, 5, "b")]);
    }
}
