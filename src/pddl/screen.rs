//! Checks a problem while it is made, without holding it.
//!
//! Objects and plain elements of `:init`, of which there may be millions, are checked one by one and forgotten; of the
//! objects, names and types are kept. Everything else is kept, and checked at the end as a problem of its own, with
//! those of the objects that it names. The answer is that nothing is wrong or odd, or that this is doubtful: then the
//! problem has to be read as a whole, by [`Problem::read`], which knows what to say.

use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use super::domain::Domain;
use super::problem::Problem;
use super::table::Table;
use super::types::{OBJECT, TypeSet};
use super::vocabulary::{ObjectEntry, Vocabulary};
use crate::formats::Source;
use crate::formats::pddl::{Dialect, NameSet, RESERVED};

/// How many bytes are kept for the check at the end.
const MAX_KEPT: usize = 4 << 20;

/// It cannot be said that nothing is wrong or odd.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Doubtful;

type Result<T = ()> = std::result::Result<T, Doubtful>;

/// A check of a problem whose text comes in parts.
#[derive(Debug)]
pub struct Screen {
    vocabulary: Vocabulary,
    constants: Table<ObjectEntry>,
    /// The predicates that rules derive.
    derived: Vec<u32>,
    /// How many brackets are open.
    depth: usize,
    section: Section,
    /// The word that the last part of the text ended with, as far as it is known.
    word: String,
    is_comment: bool,
    objects: Objects,
    has_init: bool,
    /// The element of `:init` under way, without its first bracket: words and brackets, each followed by a blank.
    element: String,
    /// Elements that are not plain.
    odd: String,
    /// The hashes of functions that have values, and the predicates of facts and of denials: two of one may contradict each other.
    valued: HashSet<u64>,
    stated: HashSet<u32>,
    denied: HashSet<u32>,
    /// What is neither in `:objects` nor in `:init`.
    rest: String,
}

/// Which part of the problem the text is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Section {
    /// Before the first word of a section.
    Start,
    Objects,
    Init,
    Other,
}

/// The objects.
#[derive(Debug, Default)]
struct Objects {
    is_there: bool,
    names: NameSet,
    /// The type of each, as a place in `types`.
    kinds: Vec<u16>,
    types: Vec<(u32, TypeSet)>,
    /// Whether the last word was the dash before a type.
    is_dash: bool,
}

impl Screen {
    /// Begins a check against a domain.
    #[must_use]
    pub fn new(domain: &Domain) -> Self {
        Self {
            vocabulary: domain.vocabulary.clone(),
            constants: domain.constants.clone(),
            derived: domain.derived.clone(),
            depth: 0,
            section: Section::Start,
            word: String::new(),
            is_comment: false,
            objects: Objects::default(),
            has_init: false,
            element: String::new(),
            odd: String::new(),
            valued: HashSet::new(),
            stated: HashSet::new(),
            denied: HashSet::new(),
            rest: String::new(),
        }
    }

    /// Goes on with the next part of the text.
    ///
    /// # Errors
    /// Where it is not certain that nothing is wrong.
    pub fn read(&mut self, text: &str) -> Result {
        let bytes = text.as_bytes();
        let mut at = 0;
        while let Some(byte) = bytes.get(at) {
            if self.is_comment {
                let rest = &bytes[at..];
                let length = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
                self.is_comment = length.is_none();
                at += length.unwrap_or(rest.len());
                continue;
            }
            let rest = &bytes[at..];
            let length = rest.iter().position(|byte| ends_word(*byte)).unwrap_or(rest.len());
            if length > 0 {
                // A word ends with what follows it, which may be in the next part.
                let word = text.get(at..at + length).ok_or(Doubtful)?;
                at += length;
                if at == bytes.len() || !self.word.is_empty() {
                    self.word.push_str(word);
                    bounded(&self.word)?;
                } else {
                    self.take_word(word)?;
                }
                continue;
            }
            self.end_word()?;
            match byte {
                b'(' => self.open()?,
                b')' => self.close()?,
                b';' => self.is_comment = true,
                _ => {}
            }
            at += 1;
        }
        Ok(())
    }

    /// Ends the check.
    ///
    /// # Errors
    /// Where it is not certain that nothing is wrong or odd.
    pub fn finish(mut self, domain: &Domain, dialect: Dialect) -> Result {
        self.end_word()?;
        if !self.denied.is_disjoint(&self.stated) {
            return Err(Doubtful);
        }
        let text = self.remaining().ok_or(Doubtful)?;
        match Problem::read(&Source::new("problem", text), domain, dialect) {
            Ok(problem) if problem.warnings().is_empty() => Ok(()),
            _ => Err(Doubtful),
        }
    }

    /// What was kept, as a problem, with the objects that it names.
    fn remaining(&self) -> Option<String> {
        let mut named: Vec<usize> =
            self.rest.split(' ').chain(self.odd.split(' ')).filter_map(|word| self.objects.names.find(word)).collect();
        named.sort_unstable();
        named.dedup();
        let (start, end) = self.rest.rsplit_once(") ").filter(|_| self.depth == 0)?;
        let mut text = start.to_owned();
        if self.objects.is_there {
            text.push_str("(:objects ");
            for number in named {
                let (kind, _) = self.objects.types.get(usize::from(*self.objects.kinds.get(number)?))?;
                let name = self.objects.names.get(number)?;
                text.push_str(&format!("{name} - {} ", self.vocabulary.types.name(*kind)));
            }
            text.push_str(") ");
        }
        if self.has_init {
            text.push_str(&format!("(:init {}) ", self.odd));
        }
        Some(text + ") " + end)
    }

    fn end_word(&mut self) -> Result {
        if self.word.is_empty() {
            return Ok(());
        }
        let word = std::mem::take(&mut self.word);
        self.take_word(&word)
    }

    fn take_word(&mut self, word: &str) -> Result {
        // In some dialects, this begins a comment.
        if word.starts_with("//") {
            return Err(Doubtful);
        }
        if self.depth == 2 && self.section == Section::Start {
            let is = |keyword: &str| word.eq_ignore_ascii_case(keyword);
            if is(":objects") && !self.objects.is_there {
                (self.section, self.objects.is_there) = (Section::Objects, true);
                return Ok(());
            }
            if is(":init") && !self.has_init {
                (self.section, self.has_init) = (Section::Init, true);
                return Ok(());
            }
            self.other()?;
        }
        match (self.section, self.depth) {
            (Section::Objects, 2) => self.object(word),
            (Section::Init, 3..) => push(&mut self.element, word),
            (Section::Init, 2) => Err(Doubtful),
            _ => self.keep(word),
        }
    }

    fn open(&mut self) -> Result {
        self.depth += 1;
        match (self.section, self.depth) {
            (_, 2) => {
                self.section = Section::Start;
                Ok(())
            }
            (Section::Objects, _) => Err(Doubtful),
            (Section::Init, 3) => Ok(()),
            (Section::Init, _) => push(&mut self.element, "("),
            (Section::Start, 3..) => {
                self.other()?;
                self.keep("(")
            }
            _ => self.keep("("),
        }
    }

    fn close(&mut self) -> Result {
        self.depth = self.depth.checked_sub(1).ok_or(Doubtful)?;
        match (self.section, self.depth) {
            (Section::Objects, 1) => {
                self.section = Section::Start;
                if self.objects.is_dash { Err(Doubtful) } else { self.objects.end_group(OBJECT) }
            }
            (Section::Init, 1) => {
                self.section = Section::Start;
                Ok(())
            }
            (Section::Init, 2) => {
                push(&mut self.element, ")")?;
                self.end_element()
            }
            (Section::Init, _) => push(&mut self.element, ")"),
            (Section::Start, 1) => {
                self.other()?;
                self.section = Section::Start;
                self.keep(")")
            }
            (_, depth) => {
                if depth == 1 {
                    self.section = Section::Start;
                }
                self.keep(")")
            }
        }
    }

    /// Begins a section that is kept.
    fn other(&mut self) -> Result {
        self.section = Section::Other;
        self.keep("(")
    }

    fn keep(&mut self, token: &str) -> Result {
        push(&mut self.rest, token)
    }

    fn object(&mut self, word: &str) -> Result {
        if self.objects.is_dash {
            self.objects.is_dash = false;
            let kind = self.vocabulary.types.find(word).filter(|_| is_plain(word)).ok_or(Doubtful)?;
            return self.objects.end_group(kind);
        }
        if word == "-" {
            self.objects.is_dash = self.objects.names.len() > self.objects.kinds.len();
            return if self.objects.is_dash { Ok(()) } else { Err(Doubtful) };
        }
        if !is_plain(word) || self.constants.find(word).is_some() {
            return Err(Doubtful);
        }
        self.objects.names.add(word).map(|_| ()).map_err(|_| Doubtful)
    }

    /// Checks an atom, or a function with its number, of plain objects; another element is kept.
    fn end_element(&mut self) -> Result {
        let mut text = std::mem::take(&mut self.element);
        let inner = text.strip_suffix(") ").unwrap_or(&text);
        let is_checked = match inner.strip_prefix("= ( ") {
            _ if !inner.contains(['(', ')', '=']) => self.is_fact(inner),
            Some(value) => self.is_value(value),
            None => false,
        };
        match inner.strip_prefix("= ( ") {
            Some(value) => {
                let call = value.split(')').next().unwrap_or_default().to_ascii_lowercase();
                let mut hasher = DefaultHasher::new();
                call.hash(&mut hasher);
                // Another value, or by chance another function.
                if !self.valued.insert(hasher.finish()) {
                    return Err(Doubtful);
                }
            }
            None => {
                let (head, is_denied) = match inner.strip_prefix("not ( ") {
                    Some(rest) => (rest, true),
                    None => (inner, false),
                };
                let number = self.vocabulary.predicates.find(head.split(' ').next().unwrap_or_default());
                if is_denied { &mut self.denied } else { &mut self.stated }.extend(number);
            }
        }
        if !is_checked {
            self.odd.push_str("( ");
            self.odd.push_str(&text);
            bounded(&self.odd)?;
        }
        text.clear();
        self.element = text;
        Ok(())
    }

    /// Whether this is a predicate with its objects, all of which are declared.
    fn is_fact(&self, words: &str) -> bool {
        let mut words = words.split_terminator(' ');
        let Some(head) = words.next().filter(|head| is_plain(head)) else { return false };
        let Some(number) = self.vocabulary.predicates.find(head) else { return false };
        let Some(predicate) = self.vocabulary.predicates.get(number) else { return false };
        !self.derived.contains(&number) && self.fit(words, predicate.parameters.iter().map(|parameter| &parameter.kind))
    }

    /// Whether this is the rest of `(= (FUNCTION OBJECT …) NUMBER)`.
    fn is_value(&self, rest: &str) -> bool {
        let Some((call, number)) = rest.split_once(") ") else { return false };
        let is_number = number.trim_end().bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'.'))
            && number.trim_end().parse::<f64>().is_ok_and(f64::is_finite);
        let mut words = call.split_terminator(' ');
        let Some(head) = words.next().filter(|head| is_number && is_plain(head)) else { return false };
        let functions = &self.vocabulary.functions;
        let Some(function) = functions.find(head).and_then(|number| functions.get(number)) else { return false };
        function.values.is_none() && self.fit(words, function.parameters.iter().map(|parameter| &parameter.kind))
    }

    /// Whether these are declared objects of these types, as many.
    fn fit<'a>(&self, words: impl Iterator<Item = &'a str>, mut wanted: impl Iterator<Item = &'a TypeSet>) -> bool {
        for word in words {
            let (Some(kind), Some(wanted)) = (self.kind(word), wanted.next()) else { return false };
            if kind != wanted && !self.vocabulary.types.fits(kind, wanted) {
                return false;
            }
        }
        wanted.next().is_none()
    }

    fn kind(&self, name: &str) -> Option<&TypeSet> {
        if let Some(number) = self.objects.names.find(name) {
            let kind = self.objects.kinds.get(number)?;
            return self.objects.types.get(usize::from(*kind)).map(|(_, kind)| kind);
        }
        let constant = self.constants.find(name)?;
        self.constants.get(constant).map(|constant| &constant.kind)
    }
}

impl Objects {
    /// Gives the objects since the last type theirs.
    fn end_group(&mut self, kind: u32) -> Result {
        let place = match self.types.iter().position(|(known, _)| *known == kind) {
            Some(place) => place,
            None => {
                self.types.push((kind, [kind].into()));
                self.types.len() - 1
            }
        };
        self.kinds.resize(self.names.len(), u16::try_from(place).map_err(|_| Doubtful)?);
        Ok(())
    }
}

/// Adds a token and a blank.
fn push(text: &mut String, token: &str) -> Result {
    text.push_str(token);
    text.push(' ');
    bounded(text)
}

fn bounded(text: &str) -> Result {
    if text.len() > MAX_KEPT { Err(Doubtful) } else { Ok(()) }
}

fn ends_word(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r' | b'(' | b')' | b';')
}

/// Whether this is a name in every dialect.
fn is_plain(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_alphabetic())
        && word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_')
        && !RESERVED.iter().chain(&["either"]).any(|reserved| reserved.eq_ignore_ascii_case(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOMAIN: &str =
        "(define (domain d) (:requirements :strips :typing :fluents) (:types box room - object crate - box)
        (:constants hall - room) (:predicates (in ?b - box ?r - room) (open) (done ?b - box))
        (:functions (weight ?b - box))
        (:derived (done ?b - box) (open)))";

    fn domain() -> Domain {
        Domain::read(&Source::new("domain", DOMAIN), Dialect::default()).unwrap()
    }

    /// Reads a problem in parts of a length.
    fn screen(problem: &str, length: usize) -> Result {
        let domain = domain();
        let mut screen = Screen::new(&domain);
        let mut rest = problem;
        while !rest.is_empty() {
            let (part, after) = rest.split_at(length.min(rest.len()));
            screen.read(part)?;
            rest = after;
        }
        screen.finish(&domain, Dialect::default())
    }

    fn problem(objects: &str, init: &str, goal: &str) -> String {
        format!("; a problem\n(define (problem p) (:domain d) (:objects {objects}) (:init {init}) (:goal {goal}))\n")
    }

    #[test]
    fn what_passes_is_right() {
        for (objects, init, goal) in [
            ("a b - box r - room", "(in a r) (in B hall) (open)", "(in a hall)"),
            ("a b", "", "(open)"),
            ("c d - crate ; why not\n R - room", "(in c r) (= (weight c) 3.5) (= (weight d) -2)", "(and (in C R))"),
            ("a - box", "(not (in a hall)) (= (weight a) (- 1))", "(forall (?b - box) (in ?b hall))"),
        ] {
            let problem = problem(objects, init, goal);
            let read = Problem::read(&Source::new("p", problem.as_str()), &domain(), Dialect::default());
            assert!(read.is_ok_and(|problem| problem.warnings().is_empty()), "{problem}");
            for length in [1, 7, problem.len()] {
                assert_eq!(screen(&problem, length), Ok(()), "{problem}");
            }
        }
    }

    #[test]
    fn what_is_wrong_or_odd_does_not_pass() {
        for (objects, init, goal) in [
            ("a - box", "(in b hall)", "(open)"),
            ("a - box", "(in a hall) (not (in a hall))", "(open)"),
            ("a - box", "(= (weight a) 1) (= (weight A) 2)", "(open)"),
            ("a - box", "(in a)", "(open)"),
            ("a - box", "(in a hall hall)", "(open)"),
            ("a - box", "(in hall a)", "(open)"),
            ("a - box", "(on a hall)", "(open)"),
            ("a - box", "(done a)", "(open)"),
            ("a - box", "(= (weight hall) 3)", "(open)"),
            ("a - box", "(= (weight a) many)", "(open)"),
            ("a - box", "open", "(open)"),
            ("a - box", "()", "(open)"),
            ("a - box", "((open))", "(open)"),
            ("a - box", "(open", "(open)"),
            ("a - box", "(open))", "(open)"),
            ("a - box", "(open)", "(in b hall)"),
            ("a - box", "(open)", ""),
            ("a - box", "", "(open)) (:goal (open)"),
            ("a - box", "", "(open)) (:init"),
            ("a - box", "", "(open)) (:objects c - box"),
            ("a - box", "", "(open)))"),
            ("a A - box", "", "(open)"),
            ("a - box a - room", "", "(open)"),
            ("hall - room", "", "(open)"),
            ("a - bax", "", "(open)"),
            ("a -box", "", "(open)"),
            ("a - ", "", "(open)"),
            ("- box", "", "(open)"),
            ("a // b", "", "(open)"),
        ] {
            let problem = problem(objects, init, goal);
            for length in [1, 7, problem.len()] {
                assert_eq!(screen(&problem, length), Err(Doubtful), "{problem}");
            }
        }
        assert_eq!(screen("", 1), Err(Doubtful));
        assert_eq!(screen("(define (problem p) (:domain e) (:objects) (:init) (:goal (open)))", 9), Err(Doubtful));
    }
}
