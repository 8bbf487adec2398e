//! Text and values become the problem; here every value is made a name or a number.

use std::borrow::Cow;
use std::collections::HashMap;

use bson::Bson;

use super::names;
use super::origin::{DocumentId, Placed, StretchKind, from_document};
use super::texts::Texts;
use crate::formats::{Diagnostic, Span};

/// A value on its way into the problem.
#[derive(Debug, Clone)]
pub(super) struct Emitted {
    /// Its text, as yet not a name.
    pub(super) text: String,
    /// Whether it is a number, spelled as PDDL spells numbers.
    pub(super) number: bool,
    /// The place in the template.
    pub(super) template: Span,
    /// Whether it is the value of that place. Else it was put into text, which another place wrote.
    pub(super) is_placed: bool,
    pub(super) document: Option<DocumentId>,
    /// Whether it is the goal: PDDL text, and no name.
    pub(super) goal: bool,
    /// The value, where it is no text.
    pub(super) value: Option<Box<Bson>>,
}

enum Part<'a> {
    /// Text, and where it stands in the template if that is known.
    Text(&'a str, Option<Place>),
    Value(Cow<'a, Emitted>),
}

impl Part<'_> {
    fn text(&self) -> &str {
        match self {
            Self::Text(text, _) => text,
            Self::Value(value) => &value.text,
        }
    }
}

/// Where text of the template stands, and the document it is written for.
#[derive(Debug, Clone)]
pub(super) struct Literal {
    pub(super) start: usize,
    pub(super) document: Option<DocumentId>,
}

/// Where text comes from.
#[derive(Debug, Clone)]
enum Place {
    Literal(Literal),
    /// What made it of other text.
    Made(Span),
}

impl Place {
    /// The place of the text `length` bytes further.
    fn after(&self, length: usize) -> Self {
        match self {
            Self::Literal(Literal { start, document }) => {
                Self::Literal(Literal { start: start + length, document: document.clone() })
            }
            Self::Made(span) => Self::Made(*span),
        }
    }
}

/// Where a name was first written, and from where.
struct Spelling {
    output: Span,
    template: Span,
    document: Option<DocumentId>,
}

/// Collects the problem token by token.
pub(super) struct Assembler<'a> {
    template: &'a Texts,
    out: String,
    placed: Vec<Placed>,
    /// The token under way; it holds a value, or is the text right before the end.
    token: Vec<Part<'a>>,
    /// Names by their folded case.
    spellings: HashMap<String, Spelling>,
    /// What names by their folded case stand for, where that is no text.
    values: HashMap<String, Bson>,
}

/// A problem put together.
#[derive(Debug, Default)]
pub(super) struct Assembled {
    pub(super) text: String,
    pub(super) placed: Vec<Placed>,
    pub(super) values: HashMap<String, Bson>,
}

/// What ends a token.
fn is_delimiter(c: char) -> bool {
    c.is_whitespace() || matches!(c, '(' | ')' | ';' | '"')
}

impl<'a> Assembler<'a> {
    pub(super) fn new(template: &'a Texts) -> Self {
        Self {
            template,
            out: String::new(),
            placed: Vec::new(),
            token: Vec::new(),
            spellings: HashMap::new(),
            values: HashMap::new(),
        }
    }

    /// Adds text whose place in the template is not known.
    pub(super) fn text(&mut self, text: &'a str) -> Result<(), Diagnostic> {
        self.stretch(text, None)
    }

    /// Adds text of the template.
    pub(super) fn literal(&mut self, text: &'a str, place: Literal) -> Result<(), Diagnostic> {
        self.stretch(text, Some(Place::Literal(place)))
    }

    /// Adds text that the expression or the tag at `template` made of other text.
    pub(super) fn made(&mut self, text: &'a str, template: Span) -> Result<(), Diagnostic> {
        self.stretch(text, Some(Place::Made(template)))
    }

    /// Adds the goal, which the marker or the expression at `template` stands for.
    pub(super) fn goal(&mut self, goal: &'a str, template: Span) -> Result<(), Diagnostic> {
        // A goal starts and ends with a parenthesis, so none of it is in a token.
        self.stretch(goal, None)?;
        let output = Span::new(self.out.len().saturating_sub(goal.len()), self.out.len());
        self.placed.push(Placed { output, template, document: None, kind: StretchKind::Goal });
        Ok(())
    }

    fn stretch(&mut self, text: &'a str, place: Option<Place>) -> Result<(), Diagnostic> {
        let after = |length: usize| place.as_ref().map(|place| place.after(length));
        let mut start = 0;
        if !self.token.is_empty() {
            start = text.find(is_delimiter).unwrap_or(text.len());
            let (head, tail) = text.split_at(start);
            if !head.is_empty() {
                self.token.push(Part::Text(head, after(0)));
            }
            if tail.is_empty() {
                return Ok(());
            }
            self.flush()?;
        }
        let rest = &text[start..];
        let tail = rest.rfind(is_delimiter).map_or(0, |at| at + rest[at..].chars().next().map_or(1, char::len_utf8));
        let (whole, open) = rest.split_at(tail);
        self.write(whole, after(start));
        if !open.is_empty() {
            self.token.push(Part::Text(open, after(start + tail)));
        }
        Ok(())
    }

    /// Writes text into the problem, and notes where it came from.
    fn write(&mut self, text: &str, place: Option<Place>) {
        let at = self.out.len();
        self.out.push_str(text);
        let output = Span::new(at, self.out.len());
        self.placed.extend(place.filter(|_| !text.is_empty()).map(|place| match place {
            Place::Literal(Literal { start, document }) => {
                Placed { output, template: Span::new(start, start + text.len()), document, kind: StretchKind::Text }
            }
            Place::Made(template) => Placed { output, template, document: None, kind: StretchKind::Made },
        }));
    }

    /// Adds a value.
    pub(super) fn value(&mut self, value: Cow<'a, Emitted>) {
        self.token.push(Part::Value(value));
    }

    /// Ends the problem.
    pub(super) fn finish(mut self) -> Result<Assembled, Diagnostic> {
        self.flush()?;
        Ok(Assembled { text: self.out, placed: self.placed, values: self.values })
    }

    fn flush(&mut self) -> Result<(), Diagnostic> {
        let mut parts = std::mem::take(&mut self.token);
        let start = self.out.len();
        let whole = joined(&parts);
        let plain = is_number(&parts, &whole);
        let mangle_all = !plain && (names::looks_mangled(&whole) || names::is_operator(&whole));
        let mut first: Option<(Span, Option<DocumentId>)> = None;
        let only = match parts.as_slice() {
            [Part::Value(value)] => value.value.as_deref().cloned(),
            _ => None,
        };
        drop(whole);
        for part in parts.drain(..) {
            match part {
                Part::Text(text, place) => self.write(text, place),
                Part::Value(value) => {
                    let at = self.out.len();
                    let token = self.out.get(start..).unwrap_or_default().trim_start_matches(['?', ':']);
                    let fits = names::is_inner(&value.text)
                        && !value.text.is_empty()
                        && (!token.is_empty() || names::is_legal(&value.text));
                    if plain || (fits && !mangle_all) {
                        self.out.push_str(&value.text);
                    } else {
                        self.out.push_str(&names::encode(&value.text));
                    }
                    if first.is_none() {
                        first = Some((value.template, value.document.clone()));
                    }
                    let output = Span::new(at, self.out.len());
                    let (template, document) = match value {
                        Cow::Owned(value) => (value.template, value.document),
                        Cow::Borrowed(value) => (value.template, value.document.clone()),
                    };
                    self.placed.push(Placed { output, template, document, kind: StretchKind::Value });
                }
            }
        }
        self.token = parts;
        if let Some(value) = only {
            let name = self.out.get(start..).unwrap_or_default().to_ascii_lowercase();
            self.values.entry(name).or_insert(value);
        }
        match first {
            Some((template, document)) if !plain => self.remember(start, template, document),
            _ => Ok(()),
        }
    }

    /// Refuses a name that differs from an earlier one in case only.
    fn remember(&mut self, start: usize, template: Span, document: Option<DocumentId>) -> Result<(), Diagnostic> {
        let output = Span::new(start, self.out.len());
        let name = self.out.get(start..).unwrap_or_default();
        let folded = match name.bytes().any(|byte| byte.is_ascii_uppercase()) {
            true => Cow::Owned(name.to_ascii_lowercase()),
            false => Cow::Borrowed(name),
        };
        let Some(known) = self.spellings.get(folded.as_ref()) else {
            self.spellings.insert(folded.into_owned(), Spelling { output, template, document });
            return Ok(());
        };
        match self.out.get(known.output.start..known.output.end).unwrap_or_default() {
            known if known == name => Ok(()),
            first => {
                let (first, name) = (names::readable(first), names::readable(name));
                let message = format!("`{first}` and `{name}` are one name to PDDL, which takes no notice of case");
                let place = self.template.place(known.template.start);
                let from = |document: &Option<DocumentId>| {
                    document
                        .as_deref()
                        .map_or(String::new(), |(namespace, id)| format!(" {}", from_document(namespace, id)))
                };
                Err(self
                    .template
                    .complain(template, message)
                    .hint(format!("`{first}` comes{} at {place}", from(&known.document)))
                    .hint(format!("`{name}` comes{}", from(&document))))
            }
        }
    }
}

fn joined<'b>(parts: &'b [Part<'_>]) -> Cow<'b, str> {
    match parts {
        [only] => Cow::Borrowed(only.text()),
        parts => parts.iter().map(Part::text).collect(),
    }
}

/// Whether the token is a number: its values are numbers, and so is the whole.
fn is_number(parts: &[Part<'_>], text: &str) -> bool {
    if parts.iter().any(|part| matches!(part, Part::Value(value) if !value.number)) {
        return false;
    }
    let digits = text.strip_prefix('-').unwrap_or(text);
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, "0"));
    let all_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    all_digits(whole) && all_digits(fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Text as itself, values between braces; a `#` makes one a number.
    fn assemble(text: &str) -> Result<String, String> {
        let texts = Texts::new(&crate::formats::Source::new("t", text), []);
        let mut assembler = Assembler::new(&texts);
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('{') {
            assembler.text(before).map_err(|error| error.to_string())?;
            let (value, after) = after.split_once('}').expect("a closed brace");
            let (number, value) = value.strip_prefix('#').map_or((false, value), |value| (true, value));
            let template = Span::at(text.len() - after.len());
            let text = value.to_owned();
            let emitted = Emitted { text, number, template, is_placed: true, document: None, goal: false, value: None };
            assembler.value(Cow::Owned(emitted));
            rest = after;
        }
        assembler.text(rest).map_err(|error| error.to_string())?;
        assembler.finish().map(|assembled| assembled.text).map_err(|error| error.to_string())
    }

    #[test]
    fn a_value_is_one_name_or_part_of_one() {
        for (template, wanted) in [
            ("(on {A} {b-1})", "(on A b-1)"),
            ("(clear {A) (on B})", "(clear x--_41_29_20_28on_20_42--x)"),
            ("(o O{#12} {RS}-I C{#2})", "(o O12 RS-I C2)"),
            ("(o {1}-I {#1}-I)", "(o x--1--x-I x--1--x-I)"),
            ("(o O{a b}-I)", "(o Ox--a_20b--x-I)"),
            ("(= (cost) {#-2.5}) {#3}", "(= (cost) -2.5) 3"),
            ("(n -{#3} {#1}.{#5} {3})", "(n -3 1.5 x--3--x)"),
            ("(n {})", "(n x----x)"),
            ("?{x} :{y}", "?x :y"),
            ("{a}{b} a{}", "ab ax----x"),
            ("{x--a--x} x{--a}", "x--x_2d_2da_2d_2dx--x xx--_2d_2da--x"),
            ("({not} {and}s n{ot} {Or})", "(x--not--x ands nx--ot--x x--_4fr--x)"),
            ("; {a\nb}", "; x--a_0ab--x"),
        ] {
            assert_eq!(assemble(template).as_deref(), Ok(wanted), "{template}");
        }
    }

    #[test]
    fn names_that_differ_in_case_only_are_refused() {
        let error = assemble("(on {Box} {box})").unwrap_err();
        assert!(error.contains("`Box` and `box` are one name"), "{error}");
        assert_eq!(assemble("{a b} {A B}").as_deref(), Ok("x--a_20b--x x--_41_20_42--x"));
    }
}
