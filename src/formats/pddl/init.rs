//! `:init`, which may hold millions of elements.
//!
//! Most of them are a predicate and its objects, or a function with its number; those are
//! read off the tokens. The rest goes through the grammar, neighbours together, so that no pair tree is ever
//! larger than a stretch of the text.

use super::ast::{Atom, Expression, Init, Name, Place, Term};
use super::grammar::Rule;
use super::outline::{Token, Tokens};
use super::section::Reader;
use super::syntax::explain;
use super::walk::parts;
use crate::formats::{Diagnostic, Span};

/// How much goes through the grammar at once, in bytes, unless a single element is larger.
const STRETCH: usize = 32 * 1024;

/// Words that no plain list begins with; the grammar knows what to do with them.
pub(crate) const RESERVED: [&str; 12] = [
    "not",
    "and",
    "or",
    "imply",
    "forall",
    "exists",
    "when",
    "assign",
    "increase",
    "decrease",
    "scale-up",
    "scale-down",
];

impl Reader<'_> {
    /// Reads all elements of the section.
    pub(super) fn init(&mut self, section: Span) -> Result<Vec<Init>, Diagnostic> {
        let mut init = Vec::new();
        let last = section.end.saturating_sub(1);
        let mut tokens = Tokens::new(self.source.text(), section.start + 1);
        tokens.next_token();
        // Where the stretch begins that the grammar has yet to see.
        let mut stretch: Option<usize> = None;
        loop {
            let before = tokens.clone();
            let at = match tokens.next_token() {
                Some(Token::Open(at)) if at < last => at,
                Some(Token::Word(span)) if span.start < last => {
                    if self.source.slice(span).starts_with("//") {
                        tokens.skip_line();
                    } else {
                        stretch.get_or_insert(span.start);
                    }
                    continue;
                }
                _ => break,
            };
            if let Some((start, end)) = stretch.map(|start| (start, at))
                && end - start >= STRETCH
            {
                self.stretch(&mut init, section, Span::new(start, end))?;
                stretch = None;
            }
            if let Some(element) = self.plain_element(&mut tokens, at) {
                if let Some(start) = stretch.take() {
                    self.stretch(&mut init, section, Span::new(start, at))?;
                }
                init.push(element);
            } else {
                stretch.get_or_insert(at);
                tokens = before;
                skip_element(&mut tokens, self.source.text());
            }
        }
        if let Some(start) = stretch {
            self.stretch(&mut init, section, Span::new(start, last))?;
        }
        Ok(init)
    }

    /// `(NAME NAME …)` or `(= (NAME NAME …) NUMBER)`, whose bracket opens at `open`.
    fn plain_element(&mut self, tokens: &mut Tokens<'_>, open: usize) -> Option<Init> {
        let Token::Word(head) = tokens.next_token()? else { return None };
        if self.source.slice(head) != "=" {
            return self.plain_atom(tokens, open, head).map(Init::Atom);
        }
        let Token::Open(inner) = tokens.next_token()? else { return None };
        let Token::Word(head) = tokens.next_token()? else { return None };
        let function = self.plain_atom(tokens, inner, head)?;
        let Token::Word(span) = tokens.next_token()? else { return None };
        let number = Expression::Number(plain_number(self.source.slice(span))?, Place(span));
        let Token::Close(_) = tokens.next_token()? else { return None };
        Some(Init::Value(Term::Call(Box::new(function)), number))
    }

    /// The rest of a list that begins with `head`, if nothing but plain names is in it.
    pub(super) fn plain_atom(&mut self, tokens: &mut Tokens<'_>, open: usize, head: Span) -> Option<Atom> {
        let name = self.plain_name(head)?;
        if RESERVED.iter().any(|word| word.len() == name.as_str().len() && name.is(word))
            || name.as_str().starts_with(['=', '<', '>'])
        {
            return None;
        }
        // Most atoms have as many as the one before.
        let mut arguments = Vec::with_capacity(self.arity);
        loop {
            match tokens.next_token()? {
                Token::Word(span) => arguments.push(Term::Name(self.plain_name(span)?)),
                Token::Close(at) => {
                    self.arity = arguments.len();
                    return Some(Atom { name, arguments, place: Place(Span::new(open, at + 1)) });
                }
                Token::Open(_) => return None,
            }
        }
    }

    /// A word that the grammar would take as a name too.
    fn plain_name(&mut self, span: Span) -> Option<Name> {
        let word = self.source.slice(span);
        let is_plain = |byte: u8| matches!(byte, b'!' | b'$'..=b'\'' | b'*'..=b'>' | b'@'..=b'~');
        let begins_well = !matches!(word.as_bytes().first()?, b':' | b'-' | b'/' | b';');
        (begins_well && word.bytes().all(is_plain)).then(|| Name::new(self.words.share(word), span))
    }

    fn stretch(&mut self, init: &mut Vec<Init>, section: Span, stretch: Span) -> Result<(), Diagnostic> {
        self.walk(stretch.start, stretch.end, Rule::init, |walk, pair| {
            parts(pair).try_for_each(|part| {
                init.push(walk.init(part)?);
                Some(())
            })
        })
        .map_err(|flaw| explain(self.source, section, &flaw))
    }
}

/// A number as the grammar has it; other spellings that Rust knows are not for here.
fn plain_number(word: &str) -> Option<f64> {
    let is_plain = word.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'.' | b'-'));
    word.parse().ok().filter(|number: &f64| is_plain && number.is_finite())
}

/// Goes on behind the list that comes next.
fn skip_element(tokens: &mut Tokens<'_>, text: &str) {
    let mut depth = 0_usize;
    while let Some(token) = tokens.next_token() {
        match token {
            Token::Open(_) => depth += 1,
            Token::Close(_) => depth = depth.saturating_sub(1),
            Token::Word(span) if text.as_bytes()[span.start..].starts_with(b"//") => tokens.skip_line(),
            Token::Word(_) => {}
        }
        if depth == 0 {
            return;
        }
    }
}
