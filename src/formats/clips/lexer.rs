//! Text to words, a stretch at a time.

use std::collections::VecDeque;

use pest::Parser as _;

use super::value::Value;
use crate::formats::{Diagnostic, Source, Span};

/// About how many bytes are split into words at once …
const STRETCH: usize = 512;
/// … and at most about so many where they are plain ones.
const SKIMMED: usize = 4096;

/// What is said to a comment of Jess or C.
const COMMENT: &str = "a comment in CLIPS begins with `;` and goes to the end of its line";

#[derive(pest_derive::Parser)]
#[grammar = "grammars/clips.pest"]
struct Grammar;

/// The kind of a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TokenKind {
    Open,
    Close,
    Text,
    Float,
    Integer,
    Symbol,
    Instance,
    Variable,
    Connective,
    End,
}

/// A word and where it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Token {
    pub(super) kind: TokenKind,
    pub(super) span: Span,
}

/// The words of a text, with a look at the next ones.
pub(super) struct Lexer<'a> {
    pub(super) source: &'a Source,
    offset: usize,
    ready: VecDeque<Token>,
    /// Remarks, in order, of the words read so far.
    remarks: VecDeque<Span>,
}

impl<'a> Lexer<'a> {
    pub(super) fn new(source: &'a Source) -> Self {
        let offset = if source.text().starts_with('\u{FEFF}') { '\u{FEFF}'.len_utf8() } else { 0 };
        Self { source, offset, ready: VecDeque::new(), remarks: VecDeque::new() }
    }

    /// The word `ahead` places from here, which stays.
    pub(super) fn peek(&mut self, ahead: usize) -> Result<Token, Diagnostic> {
        while self.ready.len() <= ahead && self.offset < self.source.text().len() {
            self.advance()?;
        }
        let end = Token { kind: TokenKind::End, span: Span::at(self.source.text().len()) };
        Ok(self.ready.get(ahead).copied().unwrap_or(end))
    }

    /// Takes the next word.
    pub(super) fn next(&mut self) -> Result<Token, Diagnostic> {
        let token = self.peek(0)?;
        self.ready.pop_front();
        Ok(token)
    }

    /// The text of a word.
    pub(super) fn text(&self, token: Token) -> &'a str {
        self.source.slice(token.span)
    }

    /// Complains about a word.
    pub(super) fn wrong(&self, token: Token, expected: &str) -> Diagnostic {
        let found = match token.kind {
            TokenKind::End => "the end of the text".to_owned(),
            TokenKind::Text => "a string".to_owned(),
            TokenKind::Variable => format!("the variable `{}`", self.text(token)),
            _ => format!("`{}`", self.text(token)),
        };
        let error = Diagnostic::new(self.source, token.span, format!("expected {expected}, found {found}"));
        match self.text(token) {
            text if text.starts_with("/*") || text.starts_with("//") => error.hint(COMMENT),
            _ => error,
        }
    }

    /// The value that a word is.
    pub(super) fn value(&self, token: Token) -> Result<Value, Diagnostic> {
        let text = self.text(token);
        let large = |what| Diagnostic::new(self.source, token.span, what);
        Ok(match token.kind {
            TokenKind::Symbol => Value::Symbol(text.to_owned()),
            TokenKind::Text => Value::Text(unescape(text)),
            TokenKind::Instance => Value::Instance(text[1..text.len() - 1].to_owned()),
            TokenKind::Integer => {
                let number = text.parse().map_err(|_| large("expected an integer of at most 64 bits"))?;
                Value::Integer(number)
            }
            TokenKind::Float => match text.parse::<f64>() {
                Ok(number) if number.is_finite() => Value::Float(number),
                _ => return Err(large("expected a float of at most 64 bits")),
            },
            TokenKind::Variable => return Err(self.wrong(token, "a value").hint("a fact holds constants only")),
            _ => return Err(self.wrong(token, "a value")),
        })
    }

    /// The slots named by the remark on the line on which a fact ends at `end`.
    pub(super) fn remark(&mut self, end: usize) -> Result<impl Iterator<Item = &'a str> + use<'a>, Diagnostic> {
        // In an assertion the remark stands behind one more `)`.
        self.peek(1)?;
        while self.remarks.front().is_some_and(|remark| remark.start < end) {
            self.remarks.pop_front();
        }
        let behind = |remark: &&Span| {
            self.source.slice(Span::new(end, remark.start)).chars().all(|between| matches!(between, ')' | ' '))
        };
        let text = self.remarks.front().filter(behind).map_or("", |remark| self.source.slice(*remark));
        Ok(text.split_whitespace().skip(3))
    }

    /// Takes plain words up to the first that is none; returns whether there were any.
    fn skim(&mut self) -> bool {
        let (bytes, start) = (self.source.text().as_bytes(), self.offset);
        while self.offset - start < SKIMMED {
            let Some((kind, length)) = bytes.get(self.offset..).and_then(plain) else { break };
            let span = Span::new(self.offset, self.offset + length);
            self.ready.extend(kind.map(|kind| Token { kind, span }));
            self.offset += length;
        }
        self.offset > start
    }

    fn advance(&mut self) -> Result<(), Diagnostic> {
        if self.skim() {
            return Ok(());
        }
        let text = self.source.text();
        let end = stretch(text, self.offset);
        let base = self.offset;
        let pairs = Grammar::parse(Rule::words, text.get(base..end).unwrap_or_default())
            .map_err(|error| self.explain(base, &error))?;
        for pair in pairs {
            let span = pair.as_span();
            let place = Span::new(base + span.start(), base + span.end());
            if pair.as_rule() == Rule::remark {
                self.remarks.push_back(place);
            }
            if let Some(kind) = kind(pair.as_rule(), pair.as_str()) {
                self.ready.push_back(Token { kind, span: place });
            }
        }
        self.offset = end;
        Ok(())
    }

    fn explain(&self, base: usize, error: &pest::error::Error<Rule>) -> Diagnostic {
        let diagnostic = Diagnostic::from_pest_at(self.source, base, error, |_| "a word of CLIPS".to_owned());
        let (before, rest) = self.source.text().split_at_checked(diagnostic.span().start).unwrap_or_default();
        if before.trim_start().starts_with("/*") {
            return diagnostic.hint(COMMENT);
        }
        if rest.starts_with('"') {
            return Diagnostic::new(self.source, diagnostic.span(), "a string without end")
                .hint("expected `\"`; inside of a string it is written `\\\"`");
        }
        diagnostic
    }
}

fn kind(rule: Rule, text: &str) -> Option<TokenKind> {
    Some(match rule {
        Rule::open => TokenKind::Open,
        Rule::close => TokenKind::Close,
        Rule::text => TokenKind::Text,
        Rule::float => TokenKind::Float,
        Rule::integer => TokenKind::Integer,
        Rule::variable => TokenKind::Variable,
        Rule::connective => TokenKind::Connective,
        Rule::symbol if text.len() > 2 && text.starts_with('[') && text.ends_with(']') => TokenKind::Instance,
        Rule::symbol => TokenKind::Symbol,
        _ => return None,
    })
}

/// The word that a text begins with, and its length, where it is one that needs no grammar; blanks are of
/// no kind. These are nearly all of what facts consist of.
fn plain(text: &[u8]) -> Option<(Option<TokenKind>, usize)> {
    let blank = |byte: &u8| matches!(byte, b' ' | b'\t' | b'\n' | b'\r' | 0x0C);
    let first = text.first()?;
    match first {
        b'(' => return Some((Some(TokenKind::Open), 1)),
        b')' => return Some((Some(TokenKind::Close), 1)),
        b'"' => {
            let end = 1 + memchr::memchr2(b'"', b'\\', text.get(1..)?)?;
            return (text.get(end) == Some(&b'"')).then_some((Some(TokenKind::Text), end + 1));
        }
        byte if blank(byte) => return Some((None, text.iter().take_while(|byte| blank(byte)).count())),
        _ => {}
    }
    let is_inner = |byte: &&u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.');
    let length = text.iter().take_while(is_inner).count();
    let (word, behind) = text.split_at_checked(length)?;
    if !behind.first().is_none_or(|byte| blank(byte) || matches!(byte, b'(' | b')')) {
        return None;
    }
    let digits = |part: &[u8]| !part.is_empty() && part.iter().all(u8::is_ascii_digit);
    let number = word.strip_prefix(b"-").unwrap_or(word);
    let kind = match number.iter().position(|byte| *byte == b'.') {
        _ if first.is_ascii_alphabetic() => TokenKind::Symbol,
        None if digits(number) => TokenKind::Integer,
        Some(point) => {
            let (whole, rest) = number.split_at_checked(point)?;
            (digits(whole) && digits(rest.get(1..)?)).then_some(TokenKind::Float)?
        }
        None => return None,
    };
    Some((Some(kind), length))
}

/// The kind of the one word that `text` is, all of it.
fn lone(text: &str) -> Option<TokenKind> {
    // Most texts are plain words, which need no grammar.
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
    if text.starts_with(|first: char| first.is_ascii_alphabetic()) && text.bytes().all(plain) {
        return Some(TokenKind::Symbol);
    }
    // No word but a string goes on behind a space.
    if text.contains(' ') && !text.starts_with('"') {
        return None;
    }
    let mut pairs = Grammar::parse(Rule::word, text).ok()?;
    let pair = pairs.next().filter(|pair| pair.as_str().len() == text.len())?;
    kind(pair.as_rule(), pair.as_str())
}

/// The end of the stretch that begins at `start`: a place outside of strings and comments where
/// no word goes on, or the end. Not only white space, or a text without any would be one stretch.
fn stretch(text: &str, start: usize) -> usize {
    enum Inside {
        Code,
        Text,
        Escape,
        Comment,
    }
    let ends_words = |byte: u8| matches!(byte, b' ' | b'\n' | b'\r' | b'\t') || b"()\";&|~<".contains(&byte);
    let mut inside = Inside::Code;
    for (index, byte) in text.bytes().enumerate().skip(start) {
        if matches!(inside, Inside::Code) && index - start >= STRETCH && ends_words(byte) {
            return index;
        }
        inside = match (inside, byte) {
            (Inside::Code, b'"') => Inside::Text,
            (Inside::Code, b';') => Inside::Comment,
            (Inside::Text, b'"') | (Inside::Comment, b'\n' | b'\r') => Inside::Code,
            (Inside::Text, b'\\') => Inside::Escape,
            (Inside::Escape, _) => Inside::Text,
            (inside, _) => inside,
        };
    }
    text.len()
}

/// The content of a string in quotes.
fn unescape(quoted: &str) -> String {
    let inner = quoted.get(1..quoted.len().saturating_sub(1)).unwrap_or_default();
    let mut text = String::with_capacity(inner.len());
    let mut characters = inner.chars();
    while let Some(character) = characters.next() {
        text.push(if character == '\\' { characters.next().unwrap_or('\\') } else { character });
    }
    text
}

/// Whether `text` is read as a symbol when it stands alone, so that it can be written without quotes.
#[must_use]
pub fn is_symbol(text: &str) -> bool {
    lone(text) == Some(TokenKind::Symbol)
}

/// Whether `text` in brackets is read as the name of an instance.
#[must_use]
pub fn is_instance(text: &str) -> bool {
    lone(&format!("[{text}]")) == Some(TokenKind::Instance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_symbols_and_names_are_told_apart_as_clips_does() {
        for text in ["+", "-", ".", "..", "-.", "+e5", ".e5", "1e", "1e+", "1.5.2", "--1", "+-1", "1e5.0", ".5e", "1a"]
        {
            assert_eq!(lone(text), Some(TokenKind::Symbol), "{text}");
        }
        for text in ["e5", "<a", "<=", "=>", "<-", "=", ":", "$", "$a", "a?", "@", "{", "[]", "[a", "[a]b", "<>", "ä"]
        {
            assert_eq!(lone(text), Some(TokenKind::Symbol), "{text}");
        }
        for text in ["1e5", "1.e5", ".5", "5.", "-.5e-3", "1E5", "-0.0"] {
            assert_eq!(lone(text), Some(TokenKind::Float), "{text}");
        }
        for text in ["0", "+5", "-0", "007"] {
            assert_eq!(lone(text), Some(TokenKind::Integer), "{text}");
        }
        for text in ["", "a b", "a<b", "a;", "a(", "a\u{1}", " a", "a\n"] {
            assert_eq!(lone(text), None, "{text}");
        }
        assert_eq!(lone("[ä]"), Some(TokenKind::Instance));
        assert_eq!(lone("$?x"), Some(TokenKind::Variable));
    }

    #[test]
    fn plain_words_are_what_the_grammar_says() {
        let words = [
            "a",
            "a-b",
            "a.b",
            "e5",
            "1",
            "-1",
            "1.5",
            "-1.5",
            "1.",
            ".5",
            "-",
            "--1",
            "1-2",
            "1e5",
            "1.5.2",
            "-.5",
            "0x1",
            "a_1",
            "nan",
            "\"\"",
            "\"a b\"",
            "\"a\\\"b\"",
            "\"ä ; (\"",
            "(",
            ")",
            "ä",
            "a<b",
            "a\"b\"",
            "\"a\"b",
            "1;x",
            "?a",
        ];
        for word in words {
            for text in [word.to_owned(), format!("({word})"), format!(" {word}\t1"), format!("{word}\u{c}{word} ")] {
                let source = Source::new("t", text.as_str());
                let mut lexer = Lexer::new(&source);
                let mut found = Vec::new();
                while lexer.peek(0).unwrap().kind != TokenKind::End {
                    found.push(lexer.next().unwrap());
                }
                let pairs = Grammar::parse(Rule::words, &text).unwrap();
                let wanted = pairs.filter_map(|pair| {
                    let span = Span::new(pair.as_span().start(), pair.as_span().end());
                    Some(Token { kind: kind(pair.as_rule(), pair.as_str())?, span })
                });
                assert_eq!(found, wanted.collect::<Vec<_>>(), "{text:?}");
            }
        }
    }

    #[test]
    fn words_are_the_same_wherever_a_stretch_ends() {
        for (text, count) in [("(", 1), ("\"a\"", 1), ("||", 2), ("<", 1), ("(a)", 3), ("a<b\"c\"", 3), ("1;\n", 1)] {
            let source = Source::new("t", text.repeat(3_000));
            let mut lexer = Lexer::new(&source);
            let kinds = std::iter::from_fn(|| lexer.next().ok().filter(|token| token.kind != TokenKind::End));
            assert_eq!(kinds.count(), count * 3_000, "{text}");
            assert!(stretch(source.text(), 0) <= STRETCH + 4, "{text}");
        }
        let text = "(a \"; ( \\\" b\") ; \"comment\n12.5 [x]\n".repeat(2_000);
        let source = Source::new("t", text);
        let mut lexer = Lexer::new(&source);
        let mut kinds = Vec::new();
        while lexer.peek(0).unwrap().kind != TokenKind::End {
            kinds.push(lexer.next().unwrap().kind);
        }
        let once = [
            TokenKind::Open,
            TokenKind::Symbol,
            TokenKind::Text,
            TokenKind::Close,
            TokenKind::Float,
            TokenKind::Instance,
        ];
        assert_eq!(kinds, once.repeat(2_000));
    }
}
