//! Text and values become the problem; here every value is made a name or a number.

use std::collections::HashMap;

use bson::Bson;

use super::names;
use super::origin::{DocumentId, Placed, StretchKind, from_document};
use crate::formats::Texts;
use crate::formats::pddl::NameSet;
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
    /// The value, where it is not a text.
    pub(super) value: Option<Box<Bson>>,
}

/// A part of the token under way.
#[derive(Debug)]
struct Part {
    /// Where it ends in the token.
    end: usize,
    kind: PartKind,
}

#[derive(Debug)]
enum PartKind {
    /// Text, and where it stands in the template if that is known.
    Text(Option<TextOrigin>),
    Value {
        number: bool,
        origin: Option<Origin>,
    },
}

/// Where a value comes from.
#[derive(Debug)]
struct Origin {
    template: Span,
    document: Option<DocumentId>,
    value: Option<Box<Bson>>,
}

/// Where text of the template stands, and the document it is written for.
#[derive(Debug, Clone)]
pub(super) struct Literal {
    pub(super) start: usize,
    pub(super) document: Option<DocumentId>,
}

/// Where text comes from.
#[derive(Debug, Clone)]
enum TextOrigin {
    Literal(Literal),
    /// What made it of other text.
    Made(Span),
}

impl TextOrigin {
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

/// Collects the problem token by token.
#[derive(Debug)]
pub(super) struct Assembler {
    template: Texts,
    out: String,
    /// The token under way; it holds a value, or is the text right before the end.
    token: String,
    parts: Vec<Part>,
    /// The names that were made of values.
    names: NameSet,
    /// Of each of them, whether a value of this text is a name as it is.
    is_legal: Vec<bool>,
    /// Where everything comes from, if it is asked for.
    notes: Option<Notes>,
}

/// Where the parts of a problem come from.
#[derive(Debug, Default)]
struct Notes {
    placed: Vec<Placed>,
    /// From where each name was first written.
    first: Vec<(Span, Option<DocumentId>)>,
    /// What names by their folded case stand for, where that is not a text.
    values: HashMap<String, Bson>,
}

/// A problem put together.
#[derive(Debug, Default)]
pub(super) struct Assembled {
    pub(super) text: String,
    pub(super) placed: Vec<Placed>,
    pub(super) values: HashMap<String, Bson>,
}

/// The most parts of a token.
const MOST_PARTS: usize = 1_000_000;

/// What ends a token.
fn is_delimiter(c: char) -> bool {
    c.is_whitespace() || matches!(c, '(' | ')' | ';' | '"')
}

impl Assembler {
    /// One that notes where everything comes from.
    pub(super) fn new(template: &Texts) -> Self {
        Self { notes: Some(Notes::default()), ..Self::without_notes(template) }
    }

    /// One that makes the same text, and knows of no part where it comes from.
    pub(super) fn without_notes(template: &Texts) -> Self {
        Self {
            template: template.clone(),
            out: String::new(),
            token: String::new(),
            parts: Vec::new(),
            names: NameSet::default(),
            is_legal: Vec::new(),
            notes: None,
        }
    }

    /// Adds text whose place in the template is not known.
    pub(super) fn text(&mut self, text: &str) -> Result<(), Diagnostic> {
        self.stretch(text, None)
    }

    /// Adds text of the template.
    pub(super) fn literal(&mut self, text: &str, place: Literal) -> Result<(), Diagnostic> {
        self.stretch(text, Some(TextOrigin::Literal(place)))
    }

    /// Adds text that the expression or the tag at `template` made of other text.
    pub(super) fn made(&mut self, text: &str, template: Span) -> Result<(), Diagnostic> {
        self.stretch(text, Some(TextOrigin::Made(template)))
    }

    /// Adds the goal, which the marker or the expression at `template` stands for.
    pub(super) fn goal(&mut self, goal: &str, template: Span) -> Result<(), Diagnostic> {
        // A goal starts and ends with a parenthesis, so none of it is in a token.
        self.stretch(goal, None)?;
        let output = Span::new(self.out.len().saturating_sub(goal.len()), self.out.len());
        if let Some(notes) = &mut self.notes {
            notes.placed.push(Placed { output, template, document: None, kind: StretchKind::Goal });
        }
        Ok(())
    }

    /// Refuses a token of so many parts that it could be larger than any memory.
    fn check_token(&self) -> Result<(), Diagnostic> {
        match self.parts.len() > MOST_PARTS {
            false => Ok(()),
            true => {
                let message =
                    format!("the template writes a word of more than {MOST_PARTS} parts; is a blank missing?");
                Err(self.template.complain(Span::default(), message))
            }
        }
    }

    fn stretch(&mut self, text: &str, place: Option<TextOrigin>) -> Result<(), Diagnostic> {
        let after = |length: usize| place.as_ref().map(|place| place.after(length));
        let mut start = 0;
        if !self.parts.is_empty() {
            start = text.find(is_delimiter).unwrap_or(text.len());
            let (head, tail) = text.split_at(start);
            if !head.is_empty() {
                self.part(head, PartKind::Text(after(0)));
            }
            if tail.is_empty() {
                return self.check_token();
            }
            self.flush()?;
        }
        let rest = &text[start..];
        let tail = rest.rfind(is_delimiter).map_or(0, |at| at + rest[at..].chars().next().map_or(1, char::len_utf8));
        let (whole, open) = rest.split_at(tail);
        self.write(whole, after(start));
        if !open.is_empty() {
            self.part(open, PartKind::Text(after(start + tail)));
        }
        Ok(())
    }

    /// Adds a part to the token.
    fn part(&mut self, text: &str, kind: PartKind) {
        // One more than there may be is kept, so that it is refused.
        if self.parts.len() > MOST_PARTS {
            return;
        }
        self.token.push_str(text);
        self.parts.push(Part { end: self.token.len(), kind });
    }

    /// Writes text into the problem, and notes where it came from.
    fn write(&mut self, text: &str, place: Option<TextOrigin>) {
        let at = self.out.len();
        self.out.push_str(text);
        let output = Span::new(at, self.out.len());
        let (Some(notes), Some(place), false) = (&mut self.notes, place, text.is_empty()) else { return };
        notes.placed.push(match place {
            TextOrigin::Literal(Literal { start, document }) => {
                Placed { output, template: Span::new(start, start + text.len()), document, kind: StretchKind::Text }
            }
            TextOrigin::Made(template) => Placed { output, template, document: None, kind: StretchKind::Made },
        });
    }

    /// Adds a value, which the expression or the filter at `template` wrote.
    pub(super) fn value(&mut self, value: &Emitted, template: Span) {
        let origin = Origin { template, document: value.document.clone(), value: value.value.clone() };
        self.part(&value.text, PartKind::Value { number: value.number, origin: Some(origin) });
    }

    /// Adds a value of which nothing is noted: its text, as yet not a name, and whether it is a number.
    pub(super) fn plain_value(&mut self, text: &str, number: bool) {
        self.part(text, PartKind::Value { number, origin: None });
    }

    /// Adds a value of which nothing is noted, and which is a token by itself: no text is before it in its token, and `next`,
    /// which comes after it, ends the token.
    pub(super) fn whole_value(&mut self, text: &str, next: &str) -> Result<bool, Diagnostic> {
        let is_whole = self.parts.is_empty()
            && self.notes.is_none()
            && next.starts_with(|c: char| c.is_ascii() && is_delimiter(c));
        if !is_whole {
            return Ok(false);
        }
        match self.names.find_exact(text) {
            Some(number) if self.is_legal.get(number).is_some_and(|is_legal| *is_legal) => self.out.push_str(text),
            _ => {
                let start = self.out.len();
                match is_free(text) {
                    true => self.out.push_str(text),
                    false => self.out.push_str(&names::encode(text)),
                }
                self.remember(start, None)?;
            }
        }
        Ok(true)
    }

    /// The text that was made so far, whole tokens; the caller may take it away where nothing is noted.
    pub(super) fn made_text(&mut self) -> &mut String {
        &mut self.out
    }

    /// Ends the problem.
    pub(super) fn finish(mut self) -> Result<Assembled, Diagnostic> {
        self.flush()?;
        let Notes { placed, values, .. } = self.notes.unwrap_or_default();
        Ok(Assembled { text: self.out, placed, values })
    }

    /// Writes the token under way.
    pub(super) fn flush(&mut self) -> Result<(), Diagnostic> {
        self.check_token()?;
        let (mut token, mut parts) = (std::mem::take(&mut self.token), std::mem::take(&mut self.parts));
        let flushed = self.put(&token, &mut parts);
        token.clear();
        parts.clear();
        (self.token, self.parts) = (token, parts);
        flushed
    }

    fn put(&mut self, token: &str, parts: &mut Vec<Part>) -> Result<(), Diagnostic> {
        let start = self.out.len();
        let plain = is_number(parts, token);
        let mangle_all = !plain && (names::looks_mangled(token) || names::is_operator(token));
        let is_single = parts.len() == 1;
        // Whether there is a value in it, and where the first one comes from.
        let (mut has_value, mut first, mut only) = (false, None, None);
        let mut begin = 0;
        for Part { end, kind } in parts.drain(..) {
            let text = token.get(begin..end).unwrap_or_default();
            begin = end;
            let origin = match kind {
                PartKind::Text(place) => {
                    self.write(text, place);
                    continue;
                }
                PartKind::Value { origin, .. } => origin,
            };
            has_value = true;
            let at = self.out.len();
            let before = self.out.get(start..).unwrap_or_default().trim_start_matches(['?', ':']);
            let fits = names::is_inner(text) && !text.is_empty() && (!before.is_empty() || names::is_legal(text));
            if plain || (fits && !mangle_all) {
                self.out.push_str(text);
            } else {
                self.out.push_str(&names::encode(text));
            }
            let output = Span::new(at, self.out.len());
            if let (Some(notes), Some(Origin { template, document, value })) = (&mut self.notes, origin) {
                only = value.filter(|_| is_single);
                first = first.or_else(|| Some((template, document.clone())));
                notes.placed.push(Placed { output, template, document, kind: StretchKind::Value });
            }
        }
        if let (Some(notes), Some(value)) = (&mut self.notes, only) {
            let name = self.out.get(start..).unwrap_or_default().to_ascii_lowercase();
            notes.values.entry(name).or_insert(*value);
        }
        if has_value && !plain { self.remember(start, first) } else { Ok(()) }
    }

    /// Refuses a name that differs from an earlier one in case only. `from` is where it comes from.
    fn remember(&mut self, start: usize, from: Option<(Span, Option<DocumentId>)>) -> Result<(), Diagnostic> {
        let name = self.out.get(start..).unwrap_or_default();
        let known = match self.names.add(name) {
            Ok(_) => {
                if self.notes.is_none() {
                    self.is_legal.push(is_free(name));
                }
                self.notes.iter_mut().for_each(|notes| notes.first.push(from.clone().unwrap_or_default()));
                return Ok(());
            }
            Err(known) => known,
        };
        let first = self.names.get(known).unwrap_or_default();
        if first == name {
            return Ok(());
        }
        let (first, name) = (names::readable(first), names::readable(name));
        let message = format!("`{first}` and `{name}` are one name to PDDL, which takes no notice of case");
        let (template, document) = from.unwrap_or_default();
        let (first_place, first_document) =
            self.notes.as_ref().and_then(|notes| notes.first.get(known)).cloned().unwrap_or_default();
        let place = self.template.place(first_place.start);
        let from = |document: &Option<DocumentId>| {
            document.as_deref().map_or(String::new(), |(namespace, id)| format!(" {}", from_document(namespace, id)))
        };
        let error = self.template.complain(template, message);
        let error = error.hint(format!("`{first}` comes{} at {place}", from(&first_document)));
        // The place of the other is that of the error.
        let second = document.is_some().then(|| format!("`{name}` comes{}", from(&document)));
        Err(second.into_iter().fold(error, Diagnostic::hint))
    }
}

/// Whether a text is a name as it is, and would not be taken for anything else.
fn is_free(text: &str) -> bool {
    names::is_legal(text) && !names::looks_mangled(text) && !names::is_operator(text)
}

/// Whether the token is a number: its values are numbers, and so is the whole.
fn is_number(parts: &[Part], text: &str) -> bool {
    if parts.iter().any(|part| matches!(part.kind, PartKind::Value { number: false, .. })) {
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
    fn fill(text: &str, mut assembler: Assembler, is_noted: bool) -> Result<String, String> {
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('{') {
            assembler.text(before).map_err(|error| error.to_string())?;
            let (value, after) = after.split_once('}').expect("a closed brace");
            let (number, value) = value.strip_prefix('#').map_or((false, value), |value| (true, value));
            let template = Span::at(text.len() - after.len());
            let text = value.to_owned();
            if is_noted {
                let emitted =
                    Emitted { text, number, template, is_placed: true, document: None, goal: false, value: None };
                assembler.value(&emitted, template);
            } else {
                assembler.plain_value(value, number);
            }
            rest = after;
        }
        assembler.text(rest).map_err(|error| error.to_string())?;
        assembler.finish().map(|assembled| assembled.text).map_err(|error| error.to_string())
    }

    #[test]
    fn a_word_of_millions_of_parts_is_refused() {
        let texts = Texts::new(&crate::formats::Source::new("t", ""), []);
        let fill = |count: usize, value: bool| {
            let mut assembler = Assembler::without_notes(&texts);
            for _ in 0..count {
                match value {
                    true => assembler.plain_value("a", false),
                    false => assembler.text("a")?,
                }
            }
            assembler.finish().map(|assembled| assembled.text.len())
        };
        assert_eq!(fill(MOST_PARTS, false).unwrap(), MOST_PARTS);
        for value in [false, true] {
            let refused = fill(2 * MOST_PARTS, value).unwrap_err();
            assert!(refused.message().contains("a word of more than 1000000 parts"), "{refused}");
        }
    }

    fn assemble(text: &str) -> Result<String, String> {
        let texts = Texts::new(&crate::formats::Source::new("t", text), []);
        let noted = fill(text, Assembler::new(&texts), true);
        let plain = fill(text, Assembler::without_notes(&texts), false);
        assert_eq!(noted.as_ref().ok(), plain.as_ref().ok(), "notes change no text");
        noted
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
            ("{a b} {x--a_20b--x} {a b}", "x--a_20b--x x--x_2d_2da_5f20b_2d_2dx--x x--a_20b--x"),
            ("?{x} {?x} ?{x} {x} {x} {ot} n{ot}", "?x x--_3fx--x ?x x x ot nx--ot--x"),
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
