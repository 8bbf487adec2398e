//! PDDL rewritten word by word, as it is written.

use std::fmt::{self, Write as _};
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};

use super::names::{Head, Names, Spelling, is_added, spelling};
use crate::formats::pddl::ast::{Atom, Domain, Init, Problem, Term};
use crate::formats::pddl::write::{AfterInit, BeforeInit, ELEMENT};

/// How much text is rewritten at once, in bytes.
pub(super) const PIECE: usize = 1 << 16;

/// How many elements of `:init` are written between two looks at whether to stop.
const ELEMENTS: usize = 4096;

/// The text of a domain in the names that are sent; nothing where `interrupted` becomes true before it is done.
pub(super) fn domain(names: &mut Names<'_>, tree: &Domain, interrupted: &AtomicBool) -> Option<String> {
    let mut rewrite = Rewrite::new(names, interrupted);
    write!(rewrite, "{tree}").ok()?;
    Some(rewrite.finish())
}

/// As [`domain`], of a problem.
pub(super) fn problem(names: &mut Names<'_>, tree: &Problem, interrupted: &AtomicBool) -> Option<String> {
    let mut rewrite = Rewrite::new(names, interrupted);
    write!(rewrite, "{}", BeforeInit(tree)).ok()?;
    rewrite.init(&tree.init).ok()?;
    write!(rewrite, "{}", AfterInit(tree)).ok()?;
    Some(rewrite.finish())
}

/// Rewrites a text as it comes, without ever having it as a whole.
struct Rewrite<'n, 'a> {
    names: &'n mut Names<'a>,
    interrupted: &'n AtomicBool,
    /// What has come and is not rewritten yet.
    pending: String,
    written: String,
    /// The lists that are open.
    heads: Vec<Head>,
}

impl fmt::Write for Rewrite<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.pending.push_str(text);
        if self.pending.len() < PIECE {
            return Ok(());
        }
        if self.interrupted.load(Ordering::Relaxed) {
            return Err(fmt::Error);
        }
        // The last word may go on.
        let whole = self.pending.rfind(is_delimiter).unwrap_or(0);
        let mut text = mem::take(&mut self.pending);
        self.rewrite(text.get(..whole).unwrap_or_default());
        text.drain(..whole);
        self.pending = text;
        Ok(())
    }
}

impl<'n, 'a> Rewrite<'n, 'a> {
    fn new(names: &'n mut Names<'a>, interrupted: &'n AtomicBool) -> Self {
        Self { names, interrupted, pending: String::new(), written: String::new(), heads: Vec::new() }
    }

    fn finish(mut self) -> String {
        self.flush();
        self.written
    }

    /// Rewrites what has come, which ends with a whole word.
    fn flush(&mut self) {
        let mut rest = mem::take(&mut self.pending);
        self.rewrite(&rest);
        rest.clear();
        self.pending = rest;
    }

    /// Writes the elements of `:init`, of which there may be millions. Most are facts of names, which are written at once.
    fn init(&mut self, elements: &[Init]) -> fmt::Result {
        self.flush();
        let mut predicate: Option<(&str, Head)> = None;
        for (place, element) in elements.iter().enumerate() {
            if place % ELEMENTS == 0 && self.interrupted.load(Ordering::Relaxed) {
                return Err(fmt::Error);
            }
            if let Init::Atom(atom) = element
                && is_of_names(atom)
            {
                let name = atom.name.as_str();
                let head = match predicate {
                    Some((known, head)) if known == name => head,
                    _ => self.names.head(name),
                };
                predicate = Some((name, head));
                if matches!(head, Head::Applied | Head::Other) {
                    self.fact(atom, head);
                    continue;
                }
            }
            write!(self.pending, "{ELEMENT}{element}")?;
            self.flush();
        }
        Ok(())
    }

    /// A fact of names, in a list whose first word makes `head` of it.
    fn fact(&mut self, atom: &Atom, head: Head) {
        self.written.push_str(ELEMENT);
        self.written.push('(');
        self.name(atom.name.as_str(), Head::Missing);
        for term in &atom.arguments {
            if let Term::Name(name) = term {
                self.written.push(' ');
                self.name(name.as_str(), head);
            }
        }
        self.written.push(')');
    }

    fn rewrite(&mut self, mut rest: &str) {
        while let Some(first) = rest.chars().next() {
            let length = match first {
                '(' | ')' => 1,
                c if c.is_whitespace() => rest.len() - rest.trim_start().len(),
                _ => word_length(rest),
            };
            let (word, after) = rest.split_at(length);
            rest = after;
            match first {
                '(' => self.heads.push(Head::Missing),
                ')' => {
                    if self.heads.pop() == Some(Head::Requirements) && self.written.ends_with(":requirements") {
                        self.written.push_str(" :strips");
                    }
                }
                c if c.is_whitespace() => {}
                _ => {
                    self.word(word);
                    continue;
                }
            }
            self.written.push_str(word);
        }
    }

    fn word(&mut self, word: &str) {
        let head = self.heads.last().copied().unwrap_or(Head::Missing);
        if head == Head::Requirements && !self.names.is_known(word) {
            self.written.truncate(self.written.trim_end().len());
            return;
        }
        if head == Head::Missing
            && let Some(slot) = self.heads.last_mut()
        {
            *slot = self.names.head(word);
        }
        if head == Head::Metric
            && let Some(slot) = self.heads.last_mut()
        {
            *slot = Head::Counting;
        } else if self.names.is_bare(word, head) {
            let _ = write!(self.written, "({})", self.names.word(word, Head::Other));
            return;
        }
        self.name(word, head);
    }

    /// A word that is more than its letters in no list but one that starts with `head`.
    fn name(&mut self, word: &str, head: Head) {
        match spelling(word) {
            Spelling::Plain if !is_added(word, head) => self.written.push_str(word),
            Spelling::PlainButForCase if !is_added(word, head) => {
                self.written.extend(word.chars().map(|letter| letter.to_ascii_lowercase()));
            }
            _ => self.written.push_str(&self.names.word(word, head)),
        }
    }
}

/// Whether a fact is of names that are one word each: of other letters than ASCII's, some are white space.
fn is_of_names(atom: &Atom) -> bool {
    let is_word = |term: &Term| matches!(term, Term::Name(name) if name.as_str().is_ascii());
    atom.name.as_str().is_ascii() && atom.arguments.iter().all(is_word)
}

/// How long the word is that a text begins with, in bytes.
fn word_length(text: &str) -> usize {
    let ends = |byte: &u8| matches!(byte, b'(' | b')' | b' ' | b'\t'..=b'\r') || !byte.is_ascii();
    match text.bytes().position(|byte| ends(&byte)) {
        // Other white space has several bytes.
        Some(end) if !text.as_bytes()[end].is_ascii() => text.find(is_delimiter).unwrap_or(text.len()),
        Some(end) => end,
        None => text.len(),
    }
}

fn is_delimiter(c: char) -> bool {
    c == '(' || c == ')' || c.is_whitespace()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;
    use crate::formats::pddl::{Dialect, read_domain, read_problem};

    #[test]
    fn facts_that_are_written_at_once_are_as_those_that_are_rewritten_word_by_word() {
        let domain = "(define (domain d) (:requirements :typing :fluents) (:types t) (:constants 7 - t)
            (:predicates (On ?a ?b - t) (at ?a - t) (reach-goal) (p.q) (number ?a - t) (long-time ?x))
            (:functions (f ?a - t) (g)) (:action A :parameters () :effect (p.q)))";
        let long = "x".repeat(120);
        let problem = format!(
            "(define (problem P) (:domain d) (:objects A.b 1a G-H total-time {long} - t)
            (:init (ON A.b 1a) (on g-h 7) (at 7) (At 5 (on 7 7)) (not (p.q)) (p.q) (reach-goal) (number G-H) (NUMBER A.B)
              (= (f 1a) 3) (= g 7) (f 7) (long-time {long}) (increase 7) (on total-time é) (on (f 1a) 7))
            (:goal (on 1a g-h)) (:metric minimize (+ g total-time)))"
        );
        let domain = read_domain(&Source::new("d", domain), Dialect::default()).unwrap();
        let mut tree =
            read_problem(&Source::new("p", problem.replace("(increase 7)", "")), Dialect::default()).unwrap();
        let interrupted = AtomicBool::new(false);
        for _ in 0..3 {
            let (mut names, mut others) = (Names::new(&domain, &tree, None), Names::new(&domain, &tree, None));
            let written = problem_text(&mut names, &tree, &interrupted);
            let mut whole = Rewrite::new(&mut others, &interrupted);
            write!(whole, "{tree}").unwrap();
            assert_eq!(written, whole.finish());
            // Names are made in the order in which words come, so that another order shows more.
            tree.init.rotate_left(5);
        }
    }

    fn problem_text(names: &mut Names<'_>, tree: &Problem, interrupted: &AtomicBool) -> String {
        super::problem(names, tree, interrupted).unwrap()
    }
}
