//! What is behind an atom of a problem: a place of the template, and documents.

use bson::Bson;

use super::minijinja;
use super::names;
use super::origin::{Generated, Origin};
use super::request::SectionReport;
use crate::formats::pddl::ast::{Atom, Condition, ConditionKind, Init, Problem, Term};
use crate::formats::{Source, Span, marker};
use crate::store::Namespace;

/// Where a problem says something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Among the objects.
    Objects,
    /// In the initial state.
    Init,
    /// In the goal.
    Goal,
}

/// An atom or an object of the problem, and where it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// Where it stands in the problem.
    pub part: Part,
    /// As the problem has it, like `(on A B)`.
    pub text: String,
    /// The line of the problem, from 1.
    pub line: usize,
    /// The place in the template.
    pub origin: Origin,
    /// The documents that its values were read from.
    pub documents: Vec<(Namespace, Bson)>,
}

/// A line of a template that could write an atom.
#[derive(Debug, Clone, PartialEq)]
pub struct Writer<'a> {
    /// The name of the template.
    pub name: String,
    /// The line of the template, from 1.
    pub line: usize,
    /// The line as it is there.
    pub text: String,
    /// The query whose documents it is written for.
    pub asked: Option<&'a SectionReport>,
    /// The conditions under which it is written, the outermost first, each with its line.
    pub conditions: Vec<(usize, String)>,
}

impl Writer<'_> {
    /// What the line depends on: the query with its number of documents, and the conditions.
    #[must_use]
    pub fn reasons(&self) -> Vec<String> {
        let conditions = self.conditions.iter().map(|(line, condition)| format!("line {line}: only {condition}"));
        self.asked.map(SectionReport::sentence).into_iter().chain(conditions).collect()
    }
}

impl Generated {
    /// What is behind an atom like `(on A B)`, a number like `(= (fuel r1) 3)`, its `(fuel r1)` or its `3`, or an
    /// object like `A`; case does not count. Nothing where the problem does not say so.
    #[must_use]
    pub fn explain_atom(&self, problem: &Problem, atom: &str) -> Vec<Explanation> {
        let wanted = [words(atom), words(&names::spell(atom))];
        let mut found = Vec::new();
        let mut note = |part, text: String, spans: Vec<Span>, also: Vec<String>| {
            let is_it = |text: &str| wanted.contains(&words(text)) || wanted.contains(&words(&restored(text)));
            if is_it(&text) || also.iter().any(|text| is_it(text)) {
                found.push(self.explanation(part, text, &spans));
            }
        };
        for object in &problem.objects {
            note(Part::Objects, object.name.as_str().to_owned(), vec![object.name.span()], Vec::new());
        }
        for element in &problem.init {
            let (spans, inner) = match element {
                Init::Atom(atom) | Init::Not(atom) => (spans(atom), Vec::new()),
                Init::At(_, _, atom) => (spans(atom), vec![atom.to_string()]),
                Init::Value(term, value) => {
                    let (mut all, function) = match term {
                        Term::Call(atom) => (spans(atom), atom.to_string()),
                        term => (vec![term.span()], format!("({term})")),
                    };
                    // The number may come from another document than the names.
                    all.push(value.span());
                    (all, vec![function, value.to_string()])
                }
            };
            note(Part::Init, element.to_string(), spans, inner);
        }
        let mut atoms = Vec::new();
        problem.goal.iter().for_each(|goal| atoms_of(goal, &mut atoms));
        for atom in atoms {
            note(Part::Goal, atom.to_string(), spans(atom), Vec::new());
        }
        found
    }

    /// The places of the template that write atoms of a predicate, each line once.
    #[must_use]
    pub fn writers(&self, predicate: &str) -> Vec<Writer<'_>> {
        let mut writers: Vec<Writer<'_>> = Vec::new();
        for (_, source) in self.template.iter() {
            let text = source.text();
            for (at, _) in text.match_indices('(') {
                let rest = text.get(at + 1..).unwrap_or_default().trim_start_matches([' ', '\t']);
                let word = rest.split(|c: char| c.is_whitespace() || "(){<".contains(c)).next();
                if !word.is_some_and(|word| word.eq_ignore_ascii_case(predicate)) {
                    continue;
                }
                let line = source.position(at).0;
                if !writers.iter().any(|writer| writer.line == line && writer.name == source.name()) {
                    writers.push(self.writer(source, line, at));
                }
            }
        }
        writers
    }

    fn writer(&self, source: &Source, line: usize, at: usize) -> Writer<'_> {
        let line_of = |span: Span| source.position(span.start).0;
        let around = minijinja::around(source.text(), at);
        let part = Some(source.name()).filter(|name| *name != self.template().name());
        let conditions = around.iter().filter_map(|block| Some((line_of(block.span), block.condition.clone()?)));
        // The query of a loop stands in its tag.
        let mut loops = around.iter().rev().filter(|block| block.is_loop);
        let in_loop = |block: &minijinja::Around| {
            let lines = line_of(block.span)..=source.position(block.span.end).0;
            self.sections.iter().find(|section| section.part.as_deref() == part && lines.contains(&section.line))
        };
        let is_bare = !["{%", "<<#"].iter().any(|mark| source.text().contains(mark));
        let above = || self.sections.iter().filter(|section| section.line <= line).max_by_key(|section| section.line);
        Writer {
            name: source.name().to_owned(),
            line,
            text: source.text().lines().nth(line - 1).unwrap_or_default().trim().to_owned(),
            asked: loops
                .find_map(in_loop)
                .or_else(|| self.marker_section(source, at))
                .or_else(|| above().filter(|_| is_bare)),
            conditions: conditions.collect(),
        }
    }

    /// What the section of a marker template asked that a place is in.
    #[must_use]
    pub fn section_of(&self, origin: &Origin) -> Option<&SectionReport> {
        let (_, source) = self.template.iter().find(|(_, source)| source.name() == origin.name)?;
        self.marker_section(source, origin.span.start)
    }

    fn marker_section(&self, source: &Source, offset: usize) -> Option<&SectionReport> {
        let template = source.text().contains("<<#").then(|| marker::parse(source).ok()).flatten()?;
        let section = template.queried_at(offset)?;
        let place = source.position(section.span.start);
        self.sections.iter().find(|report| (report.line, report.column) == place)
    }

    /// The template it was made from.
    #[must_use]
    pub fn template(&self) -> &Source {
        self.template.at(0).0
    }

    fn explanation(&self, part: Part, text: String, spans: &[Span]) -> Explanation {
        let start = spans.first().map_or(0, |span| span.start);
        let origin = self.locate(start);
        let mut documents: Vec<(Namespace, Bson)> = Vec::new();
        // What stands on the same line may come from another document; the names themselves do not lie.
        for document in spans.iter().filter_map(|span| self.value_at(*span)) {
            if !documents.contains(&document) {
                documents.push(document);
            }
        }
        documents.extend(origin.document.clone().filter(|_| documents.is_empty()));
        let line = self.source().position(start).0;
        Explanation { part, text, line, origin, documents }
    }
}

/// The place of an atom, then those of its names.
fn spans(atom: &Atom) -> Vec<Span> {
    let arguments = atom.arguments.iter().map(Term::span);
    [atom.place.0, atom.name.span()].into_iter().chain(arguments).collect()
}

fn atoms_of<'a>(condition: &'a Condition, atoms: &mut Vec<&'a Atom>) {
    match &condition.kind {
        ConditionKind::Atom(atom) => atoms.push(atom),
        ConditionKind::Not(inner)
        | ConditionKind::Forall(_, inner)
        | ConditionKind::Exists(_, inner)
        | ConditionKind::Timed(_, inner)
        | ConditionKind::Preference(_, inner) => atoms_of(inner, atoms),
        ConditionKind::And(parts) | ConditionKind::Or(parts) | ConditionKind::Modal(_, _, parts) => {
            parts.iter().for_each(|part| atoms_of(part, atoms));
        }
        ConditionKind::Imply(left, right) => {
            atoms_of(left, atoms);
            atoms_of(right, atoms);
        }
        ConditionKind::Comparison(..) => {}
    }
}

/// The words and brackets of a text, in lower case, one blank between words.
fn words(text: &str) -> String {
    let spaced = text.to_lowercase().replace('(', " ( ").replace(')', " ) ");
    spaced.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A text with the memory's spelling of its names.
fn restored(text: &str) -> String {
    let delimiter = |c: char| c.is_whitespace() || "()".contains(c);
    text.split_inclusive(delimiter)
        .map(|word| {
            let name = word.trim_end_matches(delimiter);
            format!("{}{}", names::restore(name), word.get(name.len()..).unwrap_or_default())
        })
        .collect()
}
