//! Text → its top-level lists: brackets counted, comments skipped, nothing understood.
//!
//! One pass over the bytes that keeps only a stack of open brackets, so that depth
//! is bounded and a list that is never closed is noticed where the next section
//! begins, not at the end of the text.

use super::{Dialect, MAX_DEPTH};
use crate::formats::{Diagnostic, Source, Span};

/// `(define HEAD SECTION …)`: the lists in it, as places.
#[derive(Debug)]
pub(super) struct Outline {
    /// The list with the kind and the name.
    pub(super) head: Span,
    /// The other lists.
    pub(super) sections: Vec<Span>,
    /// From `(define` to its bracket.
    pub(super) whole: Span,
}

/// Why a text has no outline.
#[derive(Debug)]
pub(super) enum Flaw {
    /// The brackets are in order, something else is not.
    Plain(Diagnostic),
    /// A list is not closed: what to say, unless the section at `.1` has a fault of its own that says more.
    Unclosed(Diagnostic, Span),
}

/// Words that begin a section, and nothing else.
const SECTIONS: [&str; 15] = [
    ":requirements",
    ":types",
    ":constants",
    ":predicates",
    ":functions",
    ":constraints",
    ":derived",
    ":action",
    ":durative-action",
    ":domain",
    ":objects",
    ":init",
    ":goal",
    ":metric",
    ":length",
];

/// Cuts a text into the lists of its `(define …)`.
pub(super) fn outline(source: &Source, dialect: Dialect) -> Result<Outline, Flaw> {
    let mut scan = Scan { source, bytes: source.text().as_bytes(), open: Vec::new(), lists: Vec::new(), whole: None };
    let mut tokens = Tokens::new(source.text(), 0);
    while let Some(token) = tokens.next_token() {
        match token {
            Token::Open(at) => {
                scan.open(at)?;
                scan.skip_words(&mut tokens);
            }
            Token::Close(at) => {
                scan.close(at)?;
                scan.skip_words(&mut tokens);
            }
            Token::Word(span) => {
                if scan.bytes[span.start..].starts_with(b"//") {
                    if !dialect.lenient {
                        return Err(Flaw::Plain(slashes(source, span)));
                    }
                    tokens.skip_line();
                } else {
                    scan.word(span)?;
                }
            }
        }
    }
    scan.finish()
}

fn slashes(source: &Source, span: Span) -> Diagnostic {
    let span = Span::new(span.start, span.start + 2);
    Diagnostic::new(source, span, "expected a list or a word, found `//`, which is not PDDL")
        .hint("comments begin with `;`; with `--lenient`, `//` to the end of the line is a comment too")
}

struct Scan<'a> {
    source: &'a Source,
    bytes: &'a [u8],
    /// Where the open brackets are.
    open: Vec<usize>,
    lists: Vec<Span>,
    whole: Option<Span>,
}

impl Scan<'_> {
    fn open(&mut self, at: usize) -> Result<(), Flaw> {
        let here = Span::new(at, at + 1);
        match self.open.as_slice() {
            [] if self.whole.is_some() => return Err(self.trailing(here)),
            [.., innermost] if self.open.len() >= 2 => {
                if let Some(keyword) = section_keyword(self.source.text(), at) {
                    return Err(self.unclosed(*innermost, Span::new(at, keyword.end)));
                }
            }
            _ => {}
        }
        if self.open.len() >= MAX_DEPTH {
            let message = format!("lists nest more than {MAX_DEPTH} deep");
            return Err(Flaw::Plain(Diagnostic::new(self.source, here, message)));
        }
        self.open.push(at);
        Ok(())
    }

    /// Goes on to the next bracket or comment in a section, where words do not matter.
    fn skip_words(&self, tokens: &mut Tokens<'_>) {
        if self.open.len() >= 2 {
            tokens.skip_words();
        }
    }

    fn close(&mut self, at: usize) -> Result<(), Flaw> {
        let here = Span::new(at, at + 1);
        let Some(opened) = self.open.pop() else {
            return Err(if self.whole.is_some() { self.trailing(here) } else { self.no_define(here) });
        };
        match self.open.len() {
            0 => self.whole = Some(Span::new(opened, at + 1)),
            1 => self.lists.push(Span::new(opened, at + 1)),
            _ => {}
        }
        Ok(())
    }

    fn word(&self, span: Span) -> Result<(), Flaw> {
        match self.open.as_slice() {
            [] if self.whole.is_some() => Err(self.trailing(span)),
            [] => Err(self.no_define(span)),
            [_] if !self.lists.is_empty() => {
                let word = shorten(self.source.slice(span));
                let message = format!("expected `(` and a section, or `)`, found `{word}`");
                let before = self.lists.last().map_or(0, |list| list.end.saturating_sub(1));
                let (line, column) = self.source.position(before);
                Err(Flaw::Plain(
                    Diagnostic::new(self.source, span, message)
                        .hint(format!("the section before it was closed at {line}:{column}")),
                ))
            }
            _ => Ok(()),
        }
    }

    fn finish(self) -> Result<Outline, Flaw> {
        let end = self.source.text().trim_end().len();
        if let Some(innermost) = self.open.last() {
            return Err(self.unclosed(*innermost, Span::at(end)));
        }
        let Some(whole) = self.whole else { return Err(self.no_define(Span::at(end))) };
        let mut lists = self.lists.into_iter();
        match lists.next() {
            Some(head) => Ok(Outline { head, sections: lists.collect(), whole }),
            None => Err(Flaw::Plain(Diagnostic::new(
                self.source,
                whole,
                "expected `(domain NAME)` or `(problem NAME)` in the list",
            ))),
        }
    }

    fn unclosed(&self, innermost: usize, here: Span) -> Flaw {
        let found = if here.start == here.end { "the end of the text" } else { self.source.slice(here) };
        let found = if here.start == here.end { found.to_owned() } else { format!("`{}`", shorten(found)) };
        let (line, column) = self.source.position(innermost);
        let diagnostic = Diagnostic::new(self.source, here, format!("expected `)`, found {found}"))
            .hint(format!("the list opened at {line}:{column} is not closed"));
        let section = match (self.open.get(1), self.lists.last()) {
            (Some(start), _) => Span::new(*start, here.start),
            // Where only the whole is not closed, the last section may have taken its bracket.
            (None, Some(last)) => *last,
            (None, None) => here,
        };
        Flaw::Unclosed(diagnostic, section)
    }

    fn trailing(&self, here: Span) -> Flaw {
        let text = self.source.text();
        let head = self.whole.and_then(|whole| Tokens::new(text, whole.start + 1).next_token());
        if let Some(Token::Word(word)) = head
            && !self.source.slice(word).eq_ignore_ascii_case("define")
        {
            return self.no_define(word);
        }
        let closed = self.whole.map_or(0, |whole| whole.end.saturating_sub(1));
        let (line, column) = self.source.position(closed);
        let message = format!("expected the end of the text, found `{}`", shorten(self.source.slice(here)));
        Flaw::Plain(
            Diagnostic::new(self.source, here, message)
                .hint(format!("the list that begins with `define` was closed at {line}:{column}")),
        )
    }

    fn no_define(&self, here: Span) -> Flaw {
        let found = match self.source.slice(here) {
            "" => "the end of the text".to_owned(),
            word => format!("`{}`", shorten(word)),
        };
        Flaw::Plain(
            Diagnostic::new(self.source, here, format!("expected `(define`, found {found}"))
                .hint("a file is one list: (define (domain NAME) …) or (define (problem NAME) …)"),
        )
    }
}

/// The keyword after the bracket at `open`, if it begins a section.
fn section_keyword(text: &str, open: usize) -> Option<Span> {
    // Most lists begin with a name.
    if text.as_bytes().get(open + 1).is_some_and(u8::is_ascii_alphabetic) {
        return None;
    }
    match Tokens::new(text, open + 1).next_token()? {
        Token::Word(span) => {
            let word = text.get(span.start..span.end)?;
            SECTIONS.iter().any(|section| section.eq_ignore_ascii_case(word)).then_some(span)
        }
        _ => None,
    }
}

fn shorten(word: &str) -> String {
    let mut short: String = word.chars().take(24).collect();
    if short.len() < word.len() {
        short.push('…');
    }
    short
}

/// A bracket or a word, by place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Token {
    /// `(`
    Open(usize),
    /// `)`
    Close(usize),
    /// Anything else up to white space, a bracket or a comment.
    Word(Span),
}

/// The brackets and words of a text; `;` comments are skipped, `//` comes as a word.
#[derive(Clone)]
pub(crate) struct Tokens<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Tokens<'a> {
    /// The tokens from byte `at` on.
    pub(crate) fn new(text: &'a str, at: usize) -> Self {
        Self { bytes: text.as_bytes(), at }
    }

    /// The next one, if there is one.
    pub(crate) fn next_token(&mut self) -> Option<Token> {
        loop {
            let at = self.at;
            match *self.bytes.get(at)? {
                b' ' | b'\t'..=b'\r' => self.at += 1,
                0xEF if self.bytes[at..].starts_with("\u{feff}".as_bytes()) => self.at += 3,
                b';' => self.skip_line(),
                b'(' => {
                    self.at += 1;
                    return Some(Token::Open(at));
                }
                b')' => {
                    self.at += 1;
                    return Some(Token::Close(at));
                }
                _ => {
                    let rest = &self.bytes[at..];
                    let length = rest.iter().position(|byte| ends_word(*byte)).unwrap_or(rest.len());
                    self.at += length;
                    return Some(Token::Word(Span::new(at, at + length)));
                }
            }
        }
    }

    /// Goes on, behind a bracket, to the next bracket or to what may be a comment.
    fn skip_words(&mut self) {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let mut is_start = true;
        let end = rest.iter().position(|byte| {
            let is_end = match byte {
                b'(' | b')' | b';' => true,
                // `//` is a comment where a word may begin, also behind a byte order mark.
                b'/' | 0xEF => is_start,
                _ => false,
            };
            is_start = matches!(byte, b' ' | b'\t'..=b'\r');
            is_end
        });
        self.at += end.unwrap_or(rest.len());
    }

    /// Goes on behind the line's end, from wherever the last token began.
    pub(super) fn skip_line(&mut self) {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        self.at += rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(rest.len());
    }
}

fn ends_word(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r' | b'(' | b')' | b';')
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The brackets, and the words that are comments.
    fn marks(text: &str, skips: bool) -> Vec<Token> {
        let mut tokens = Tokens::new(text, 0);
        let mut marks = Vec::new();
        while let Some(token) = tokens.next_token() {
            match token {
                Token::Word(span) if text.as_bytes()[span.start..].starts_with(b"//") => {
                    tokens.skip_line();
                    marks.push(token);
                }
                Token::Word(_) => {}
                _ => {
                    marks.push(token);
                    if skips {
                        tokens.skip_words();
                    }
                }
            }
        }
        marks
    }

    proptest! {
        #[test]
        fn what_is_skipped_is_words_alone(text in "[() ;/\u{feff}\u{ff08}a\n\t:-]{0,60}") {
            prop_assert_eq!(marks(&text, true), marks(&text, false));
        }
    }
}
