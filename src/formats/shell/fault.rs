//! The first place where a text stops being a value, and what was expected there.
//!
//! pest reports the furthest place at which a whole rule failed, which is often
//! the start of a value. This looks at a text that the parser has refused once
//! more, token by token and without recursion, and names the first token that fits nowhere.

use pest::Parser as _;

use super::grammar::{Rule, ShellParser};
use super::{constructor, foreign, scanner};
use crate::formats::{Diagnostic, Source, Span};

/// The most characters of a token that a message repeats.
const TOKEN_WINDOW: usize = 40;

/// What may come next.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Next {
    Value,
    /// In an array or a call, where it may close as well.
    ValueOrClose,
    KeyOrClose,
    Colon,
    CommaOrClose,
}

/// A bracket that is open: which, and where.
type Open = (u8, usize);

/// What the text from `start` up to `end` does wrong as one value; `None` if nothing is found.
pub(super) fn find(source: &Source, span: Span) -> Option<Diagnostic> {
    let mut checker = Checker { source, end: span.end, open: Vec::new(), at: span.start, key: None };
    if let Err(fault) = checker.value() {
        return Some(fault);
    }
    checker.blank();
    let rest = checker.rest();
    (!rest.is_empty()).then(|| unexpected(source, Span::new(checker.at, span.end), "the end of the text"))
}

/// Where the value that starts at the start of `span` ends.
pub(super) fn end_of_value(source: &Source, span: Span) -> Result<usize, Diagnostic> {
    let mut checker = Checker { source, end: span.end, open: Vec::new(), at: span.start, key: None };
    checker.value().map(|()| checker.at)
}

/// Complains about what stands at the start of `rest`: `expected` should, or a comment is not closed.
pub(super) fn unexpected(source: &Source, rest: Span, expected: &str) -> Diagnostic {
    let text = source.slice(rest);
    if text.starts_with("/*") {
        return Diagnostic::new(source, Span::at(rest.start), "the comment has no end")
            .unterminated()
            .hint("it ends with `*/`");
    }
    let token = token(text);
    let span = Span::new(rest.start, rest.start + token.len());
    let found = match token.chars().count() {
        0 => "the end of the text".to_owned(),
        length if length > TOKEN_WINDOW => format!("`{}…`", token.chars().take(TOKEN_WINDOW).collect::<String>()),
        _ => format!("`{token}`"),
    };
    let diagnostic = Diagnostic::new(source, span, format!("expected {expected}, found {found}"));
    if token.is_empty() { diagnostic.unterminated() } else { diagnostic }
}

/// A word or a number at the start of `text`, or its first character.
fn token(text: &str) -> &str {
    let signed = text
        .strip_prefix(['+', '-'])
        .is_some_and(|rest| rest.starts_with(['I', 'N', '.']) || rest.starts_with(|c: char| c.is_ascii_digit()));
    let sign = usize::from(signed);
    let rest = text.get(sign..).unwrap_or_default();
    let mut previous = ' ';
    let end = rest.find(|c: char| {
        let exponent =
            matches!(c, '+' | '-') && matches!(previous, 'e' | 'E') && rest.starts_with(|c: char| c.is_ascii_digit());
        previous = c;
        !(c.is_alphanumeric() || matches!(c, '_' | '$' | '.') || exponent)
    });
    match sign + end.unwrap_or(rest.len()) {
        length if length > sign => text.get(..length).unwrap_or(text),
        _ => text.chars().next().and_then(|c| text.get(..c.len_utf8())).unwrap_or_default(),
    }
}

fn is_name_part(c: char) -> bool {
    c.is_alphanumeric() || matches!(c, '_' | '$')
}

struct Checker<'a> {
    source: &'a Source,
    end: usize,
    open: Vec<Open>,
    at: usize,
    /// The bare key before the colon that comes next.
    key: Option<usize>,
}

impl<'a> Checker<'a> {
    fn rest(&self) -> &'a str {
        self.source.slice(Span::new(self.at, self.end))
    }

    /// Goes past white space and comments.
    fn blank(&mut self) {
        self.at = scanner::skip(self.source.text(), self.at, b"").min(self.end);
    }

    /// Goes past one value.
    fn value(&mut self) -> Result<(), Diagnostic> {
        let mut next = Next::Value;
        loop {
            self.blank();
            let first = self.rest().bytes().next();
            if next != Next::Value && next != Next::Colon && first.is_some() && first == self.closer() {
                self.open.pop();
                self.at += 1;
                next = Next::CommaOrClose;
            } else {
                next = match next {
                    Next::Value | Next::ValueOrClose => self.one(next)?,
                    Next::KeyOrClose => self.key()?,
                    Next::Colon if first == Some(b':') => self.after(1, Next::Value),
                    Next::Colon => return Err(self.no_colon()),
                    Next::CommaOrClose if first == Some(b',') => {
                        let document = matches!(self.open.last(), Some((b'{', _)));
                        self.after(1, if document { Next::KeyOrClose } else { Next::ValueOrClose })
                    }
                    Next::CommaOrClose => return Err(self.fault(&format!("`,` or {}", self.closing()))),
                };
            }
            if self.open.is_empty() && next == Next::CommaOrClose {
                return Ok(());
            }
        }
    }

    fn after(&mut self, length: usize, next: Next) -> Next {
        self.at += length;
        next
    }

    /// What closes the innermost bracket.
    fn closer(&self) -> Option<u8> {
        self.open.last().map(|(bracket, _)| match bracket {
            b'{' => b'}',
            b'[' => b']',
            _ => b')',
        })
    }

    fn closing(&self) -> String {
        self.closer().map_or_else(|| "the end of the text".to_owned(), |closer| format!("`{}`", char::from(closer)))
    }

    /// What stands here does not fit; where the text ends or the wrong bracket closes, says what is open.
    fn fault(&self, expected: &str) -> Diagnostic {
        let rest = self.rest();
        let diagnostic = unexpected(self.source, Span::new(self.at, self.end), expected);
        match self.open.last() {
            Some((bracket, start)) if rest.is_empty() || rest.starts_with(['}', ']', ')']) => {
                let (line, column) = self.source.position(*start);
                diagnostic.hint(format!("the `{}` at {line}:{column} is not closed", char::from(*bracket)))
            }
            _ => diagnostic,
        }
    }

    /// Goes past a scalar, or into brackets.
    fn one(&mut self, next: Next) -> Result<Next, Diagnostic> {
        let rest = self.rest();
        let expected = match next {
            Next::ValueOrClose => format!("a value or {}", self.closing()),
            _ => "a value".to_owned(),
        };
        match rest.chars().next() {
            Some('{') => Ok(self.enter(b'{', 1, Next::KeyOrClose)),
            Some('[') => Ok(self.enter(b'[', 1, Next::ValueOrClose)),
            Some('"' | '\'') => self.string().map(|()| Next::CommaOrClose),
            Some('/') if !rest.starts_with("/*") => self.regex().map(|()| Next::CommaOrClose),
            Some(c) if is_name_part(c) && !c.is_numeric() => self.word(),
            _ => {
                let token = token(rest);
                let whole = ShellParser::parse(Rule::number, token).is_ok_and(|pairs| pairs.as_str() == token);
                if !whole {
                    let fault = self.fault(&expected);
                    let hint = self.in_parentheses().or_else(|| foreign::hint(rest));
                    return Err(hint.into_iter().fold(fault, Diagnostic::hint));
                }
                Ok(self.after(token.len(), Next::CommaOrClose))
            }
        }
    }

    fn enter(&mut self, bracket: u8, length: usize, next: Next) -> Next {
        self.open.push((bracket, self.at + length - 1));
        self.after(length, next)
    }

    fn string(&mut self) -> Result<(), Diagnostic> {
        match scanner::string_end(self.rest()) {
            Some(length) => self.at += length,
            None => {
                let span = Span::new(self.at, self.at + 1);
                return Err(Diagnostic::new(self.source, span, "the string has no end")
                    .unterminated()
                    .hint("it ends with the same quote, on the same line"));
            }
        }
        Ok(())
    }

    fn regex(&mut self) -> Result<(), Diagnostic> {
        let parsed = ShellParser::parse(Rule::regex, self.rest());
        if let Ok(pairs) = parsed {
            self.at += pairs.as_str().len();
            return Ok(());
        }
        let wrong = |message| Diagnostic::new(self.source, Span::new(self.at, self.at + 1), message);
        Err(match scanner::regex_end(self.rest()) {
            Some(_) => wrong("the regular expression has no end, or something follows its options"),
            None => wrong("the regular expression has no end").unterminated(),
        })
    }

    /// A constant, or a constructor with its bracket.
    fn word(&mut self) -> Result<Next, Diagnostic> {
        let rest = self.rest();
        let length = |text: &str| text.find(|c| !is_name_part(c)).unwrap_or(text.len());
        let mut end = length(rest);
        let blank = |end| scanner::skip(self.source.text(), self.at + end, b"").min(self.end) - self.at;
        let mut name = rest.get(..end).unwrap_or_default();
        if name == "new" && blank(end) > end {
            let start = blank(end);
            let after = rest.get(start..).unwrap_or_default();
            end = start + length(after);
            name = rest.get(start..end).unwrap_or_default();
        }
        if name == "Date" && rest.get(end..).is_some_and(|after| after.starts_with(".now")) {
            end += ".now".len();
            name = "Date.now";
        }
        let bracket = blank(end);
        let is_call = rest.get(bracket..).is_some_and(|after| after.starts_with('('));
        if is_call && (constructor::is_known(name) || foreign::hint(rest).is_none()) {
            return Ok(self.enter(b'(', bracket + 1, Next::ValueOrClose));
        }
        if let Some(hint) = self.without_braces(name, bracket) {
            return Err(self.fault("a value").hint(hint));
        }
        if is_call || constructor::word(name).is_none() {
            return Err(self.fault("a value").hint(foreign::hint_of_word(rest)));
        }
        Ok(self.after(end, Next::CommaOrClose))
    }

    /// What to write for a document in parentheses, as JavaScript takes it.
    fn in_parentheses(&self) -> Option<String> {
        let inner = self.rest().strip_prefix('(').filter(|_| self.open.is_empty())?.trim();
        let inner = inner.strip_suffix(')').unwrap_or(inner).trim();
        inner.starts_with(['{', '[']).then(|| match inner.chars().count() {
            length if length <= TOKEN_WINDOW => format!("leave out the parentheses: {inner}"),
            _ => "leave out the parentheses".to_owned(),
        })
    }

    /// What to write for a key or an operator with its value at the place of a value: its braces are missing. The colon is
    /// `colon` bytes behind the start of the name.
    fn without_braces(&self, name: &str, colon: usize) -> Option<String> {
        let value = self.rest().get(colon..)?.strip_prefix(':')?;
        // `http://…` and `12:30` are texts.
        let is_apart = value.starts_with(|c: char| c.is_whitespace() || "{[\"'".contains(c));
        if !(is_apart || name.starts_with('$')) {
            return None;
        }
        let start = self.end - value.len();
        let is_whole = self.source.slice(Span::new(0, self.at)).trim().is_empty();
        let end = match is_whole {
            true => Some(self.end),
            false => end_of_value(self.source, Span::new(start, self.end)).ok(),
        };
        let text = end.map(|end| self.source.slice(Span::new(self.at, end)).trim());
        let text =
            text.filter(|text| text.chars().count() <= TOKEN_WINDOW && !text.ends_with(':') && !text.contains('\n'));
        let written = text.map_or_else(|| format!("{{{name}: …}}"), |text| format!("{{{text}}}"));
        Some(match is_whole {
            true => format!("a document is written in braces: {written}"),
            false => format!("a key and its value stand in braces: {written}"),
        })
    }

    fn key(&mut self) -> Result<Next, Diagnostic> {
        let rest = self.rest();
        if rest.starts_with(['"', '\'']) {
            self.key = None;
            return self.string().map(|()| Next::Colon);
        }
        let end = rest.find(|c| !(is_name_part(c) || c == '-')).unwrap_or(rest.len());
        let name = rest.get(..end).unwrap_or_default().trim_end_matches('-');
        let end = name.len();
        let digits = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit());
        if name.is_empty() || (name.starts_with(char::is_numeric) && !digits) {
            let diagnostic = self.fault("a key or `}`");
            return Err(match name {
                "" if rest.starts_with(':') => diagnostic
                    .hint("in double quotes, a shell replaces a name behind `$`; write `\\$` there, or use single quotes outside"),
                "" => diagnostic,
                _ => diagnostic.hint(format!("quote the key: '{name}'")),
            });
        }
        self.key = Some(self.at);
        Ok(self.after(end, Next::Colon))
    }

    /// A bare key that goes on with what only a quoted one can hold is a key without quotes.
    fn no_colon(&self) -> Diagnostic {
        let diagnostic = self.fault("`:`");
        let Some(start) = self.key else { return diagnostic };
        if self.rest().starts_with(['}', ',']) {
            let name = self.source.slice(Span::new(start, self.at)).trim();
            return diagnostic.without_hints().hint(format!("`{name}` needs a value: {{{name}: 1}}"));
        }
        let text = self.source.slice(Span::new(start, self.end));
        let length = text.find(|c: char| !is_name_part(c) && !matches!(c, '-' | '.')).unwrap_or(text.len());
        if start + length <= self.at {
            return diagnostic;
        }
        diagnostic.hint(format!("quote the key: '{}'", text.get(..length).unwrap_or_default()))
    }
}
