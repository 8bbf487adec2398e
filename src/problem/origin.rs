//! Where each part of a problem came from.

use std::collections::HashMap;
use std::sync::Arc;

use bson::{Bson, RawDocument};

use super::{SectionReport, names};
use crate::formats::Texts;
use crate::formats::pddl::Dialect;
use crate::formats::{Diagnostic, Source, Span};
use crate::pddl::{Domain, Problem};
use crate::store::Namespace;

/// A document that a value was read from: its namespace and `_id`, shared by all its values.
pub(super) type DocumentId = Arc<(Arc<Namespace>, Bson)>;

/// What names a document; nothing where it has no `_id`.
pub(super) fn document_id(namespace: &Arc<Namespace>, document: &RawDocument) -> Option<DocumentId> {
    let id = document.get("_id").ok().flatten()?;
    Some(Arc::new((Arc::clone(namespace), Bson::try_from(id).ok()?)))
}

/// Where a place of the problem came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// The template's name, or that of a template that it names.
    pub name: String,
    /// The place in it.
    pub span: Span,
    /// The line as it is there.
    pub written: String,
    /// Its line, from 1.
    pub line: usize,
    /// Its column, from 1.
    pub column: usize,
    /// The namespace and `_id` of the document, where one was involved.
    pub document: Option<(Namespace, Bson)>,
}

/// What made a stretch of the problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StretchKind {
    Value,
    /// Text of the template, as it is there.
    Text,
    /// Text that an expression or a filter made of other text.
    Made,
    Goal,
}

/// A stretch of the problem whose place in the template is known.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Placed {
    /// In the problem.
    pub(super) output: Span,
    /// In the template.
    pub(super) template: Span,
    pub(super) document: Option<DocumentId>,
    pub(super) kind: StretchKind,
}

/// A problem, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Generated {
    /// The PDDL text.
    pub text: String,
    /// The queries of the template in the order in which they were first asked.
    pub sections: Vec<SectionReport>,
    /// All namespaces that the template asked, for whatever, in the order in which they were first asked.
    pub namespaces: Vec<Namespace>,
    /// Keys that documents have in another spelling than the template: sentences for the user.
    pub respelled: Vec<String>,
    /// Oddities of the template that the problem depends on, each at its place.
    pub remarks: Vec<Diagnostic>,
    /// Whether a goal was given that nothing of what was rendered used.
    pub is_goal_unused: bool,
    pub(super) template: Texts,
    /// In the order of the output, without overlaps.
    pub(super) placed: Vec<Placed>,
    /// The values of names, in lower case, that are no texts.
    pub(super) values: HashMap<String, Bson>,
}

impl Generated {
    /// The problem as a text to be read; it goes by the template's name.
    #[must_use]
    pub fn source(&self) -> Source {
        Source::new(format!("{} (generated)", self.template.at(0).0.name()), self.text.as_str())
    }

    /// Reads the problem and checks it against its domain.
    ///
    /// # Errors
    /// What is wrong with it, each at the template's place.
    pub fn check(&self, domain: &Domain, dialect: Dialect) -> Result<Problem, Vec<Diagnostic>> {
        Problem::read(&self.source(), domain, dialect).map_err(|complaints| self.explain(complaints))
    }

    /// The memory's value for a name of the problem: of its own type where the whole name was a number, a
    /// truth value or an ObjectId, else the text that the name stands for. Where several of those
    /// have one name, it is the first that was written.
    #[must_use]
    pub fn value(&self, name: &str) -> Bson {
        let known = self.values.get(&name.to_ascii_lowercase()).cloned();
        known.unwrap_or_else(|| Bson::String(names::restore(name)))
    }

    /// The document of a value that stands at this place of the problem.
    pub(super) fn value_at(&self, place: Span) -> Option<(Namespace, Bson)> {
        let next = self.placed.partition_point(|placed| placed.output.end <= place.start);
        let within = self.placed.iter().skip(next).take_while(|placed| placed.output.start < place.end);
        let mut values =
            within.filter(|placed| placed.kind == StretchKind::Value && placed.output.start >= place.start);
        let (namespace, id) = values.find_map(|placed| placed.document.as_deref())?;
        Some((namespace.as_ref().clone(), id.clone()))
    }

    /// Where the byte at `offset` of the problem came from.
    #[must_use]
    pub fn locate(&self, offset: usize) -> Origin {
        let (span, document) = self.origin(Span::at(offset));
        let (source, span) = self.template.locate(span);
        let (line, column) = source.position(span.start);
        Origin {
            name: source.name().to_owned(),
            span,
            written: source.text().lines().nth(line.saturating_sub(1)).unwrap_or_default().trim().to_owned(),
            line,
            column,
            document: document.map(|document| (document.0.as_ref().clone(), document.1.clone())),
        }
    }

    /// Where a stretch of the problem came from; of fixed text as far as the template has it in one piece.
    fn origin(&self, stretch: Span) -> (Span, Option<&DocumentId>) {
        let offset = stretch.start;
        let next = self.placed.partition_point(|placed| placed.output.end <= offset);
        if let Some(inside) = self.placed.get(next).filter(|placed| placed.output.start <= offset) {
            if inside.kind != StretchKind::Text {
                return (inside.template, inside.document.as_ref());
            }
            let shift = |at: usize| inside.template.start + at - inside.output.start;
            let span = Span::new(shift(offset), shift(stretch.end.clamp(offset, inside.output.end)));
            return (span, inside.document.as_ref().or_else(|| self.on_line(next, offset)));
        }
        let before = next.checked_sub(1).and_then(|index| self.placed.get(index));
        let after = self.placed.get(next);
        let (start, at) = before.map_or((0, 0), |placed| (placed.output.end, placed.template.end));
        let place = self
            .same_after(start, at, offset)
            .or_else(|| self.same_before(after, offset))
            .unwrap_or_else(|| before.or(after).map_or(at, |placed| placed.template.start));
        (Span::at(place), self.on_line(next, offset))
    }

    /// The template's offset if the text from `start` to `offset` is the template's from `at` on.
    fn same_after(&self, start: usize, at: usize, offset: usize) -> Option<usize> {
        let made = self.text.get(start..offset)?;
        let (source, base) = self.template.at(at);
        source.text().get(at - base..)?.starts_with(made).then(|| at + made.len())
    }

    /// The same from `offset` up to the value that comes next, or the end.
    fn same_before(&self, after: Option<&Placed>, offset: usize) -> Option<usize> {
        let last = || self.template.at(0).0.text().len();
        let (end, at) =
            after.map_or_else(|| (self.text.len(), last()), |placed| (placed.output.start, placed.template.start));
        let made = self.text.get(offset..end)?;
        let (source, base) = self.template.at(at);
        source.text().get(..at - base)?.ends_with(made).then(|| at - made.len())
    }

    /// The document of a value on the same line of the problem: of one that comes after `offset`, or of one before it. `next`
    /// is the first stretch that ends behind `offset`.
    fn on_line(&self, next: usize, offset: usize) -> Option<&DocumentId> {
        let is_line = |start, end| self.text.get(start..end).is_none_or(|text| !text.contains('\n'));
        let after = self.placed.iter().skip(next).take_while(|placed| is_line(offset, placed.output.start));
        let before = self.placed.iter().take(next).rev().take_while(|placed| is_line(placed.output.end, offset));
        after.chain(before).find_map(|placed| placed.document.as_ref())
    }

    /// Turns complaints about the problem into complaints about the template.
    /// Each shows the generated line and names the document as hints; what a
    /// section got wrong for many documents is reported once.
    #[must_use]
    pub fn explain(&self, complaints: Vec<Diagnostic>) -> Vec<Diagnostic> {
        self.explain_as(complaints, "problem")
    }

    /// Reads the text as a domain, where the template is that of a domain.
    ///
    /// # Errors
    /// What is wrong with it, each at the template's place.
    pub fn check_domain(&self, dialect: Dialect) -> Result<Domain, Vec<Diagnostic>> {
        Domain::read(&self.source(), dialect).map_err(|complaints| self.explain_as(complaints, "domain"))
    }

    /// The same as [`Generated::explain`] of a `whole`: a problem or a domain.
    fn explain_as(&self, complaints: Vec<Diagnostic>, whole: &str) -> Vec<Diagnostic> {
        let mut explained: Vec<(Diagnostic, usize)> = Vec::new();
        for complaint in &complaints {
            let complaint = self.at_template(complaint, whole);
            let is_quoted = |of: &Diagnostic| of.hints().iter().any(|hint| hint == SINGLE_QUOTES);
            let same = |(other, _): &&mut (Diagnostic, usize)| {
                other.name() == complaint.name()
                    && other.span() == complaint.span()
                    && (other.message() == complaint.message() || is_quoted(other) && is_quoted(&complaint))
            };
            match explained.iter_mut().find(same) {
                Some((_, more)) => *more += 1,
                None => explained.push((complaint, 0)),
            }
        }
        let counted = |(complaint, more): (Diagnostic, usize)| match more {
            0 => complaint,
            1 => complaint.hint("and from 1 more place"),
            _ => complaint.hint(format!("and from {more} more places")),
        };
        explained.into_iter().map(counted).collect()
    }

    /// The goal, if the byte at `offset` is in it.
    fn goal_around(&self, offset: usize) -> Option<&str> {
        let placed = self.placed.get(self.placed.partition_point(|placed| placed.output.end <= offset))?;
        let goal = placed.kind == StretchKind::Goal && placed.output.start <= offset;
        self.text.get(placed.output.start..placed.output.end).filter(|_| goal)
    }

    /// A name of several words of the problem that stands in the goal without quotes.
    fn unquoted(&self, goal: &str) -> Option<String> {
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        let known = self.text.split(|c| !is_name(c)).filter(|name| names::looks_mangled(name)).map(names::restore);
        let is_end = |c: Option<char>| c.is_none_or(|c| c.is_whitespace() || matches!(c, '(' | ')'));
        let is_unquoted = |name: &String| {
            goal.match_indices(name.as_str()).any(|(start, _)| {
                let (before, after) = (goal.get(..start), goal.get(start + name.len()..));
                is_end(before.and_then(|text| text.chars().next_back()))
                    && is_end(after.and_then(|text| text.chars().next()))
            })
        };
        known.filter(|name| name.contains(' ')).find(is_unquoted)
    }

    fn at_template(&self, complaint: &Diagnostic, whole: &str) -> Diagnostic {
        let offset = complaint.span().start.min(self.text.len());
        let (span, document) = self.origin(Span::new(offset, complaint.span().end.max(offset)));
        let start = self.text.get(..offset).and_then(|text| text.rfind('\n')).map_or(0, |newline| newline + 1);
        let line = self.text.get(start..).and_then(|rest| rest.lines().next()).unwrap_or_default().trim();
        let short = excerpt(&names::readable(line));
        let number = self.source().position(offset).0;
        let diagnostic = self.template.complain(span, names::readable(complaint.message()));
        let diagnostic = diagnostic.of_kind(complaint);
        let diagnostic = complaint
            .hints()
            .iter()
            .fold(diagnostic, |diagnostic, hint| diagnostic.hint(names::readable(&self.at_places(hint))));
        let goal = self.goal_around(offset);
        let diagnostic = match goal {
            Some(goal) => {
                let goal = names::readable(goal);
                let diagnostic = diagnostic.hint(format!("the goal is {}", excerpt(&goal)));
                match self.unquoted(&goal) {
                    Some(name) => diagnostic
                        .hint(format!("a name of several words is written in quotes: {}", names::written(&name))),
                    None if goal.contains('\'') => diagnostic.hint(SINGLE_QUOTES),
                    None => diagnostic,
                }
            }
            None => diagnostic,
        };
        let diagnostic = diagnostic.hint(format!("it became line {number} of the {whole}: {short}"));
        match document.map(AsRef::as_ref) {
            Some((namespace, id)) if complaint.message().starts_with("expected a number, found `") => {
                let from = from_document(namespace, id);
                diagnostic.hint(format!("{from}, which has a text there; store a number, or leave the document out"))
            }
            Some((namespace, id)) => diagnostic.hint(from_document(namespace, id)),
            None => diagnostic,
        }
    }
}

impl Generated {
    /// A hint with the template's places, like `opened at 3:5`, instead of the problem's.
    fn at_places(&self, hint: &str) -> String {
        let mut parts = hint.split(" at ");
        let mut text = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            let end = part.find(|c: char| !c.is_ascii_digit() && c != ':').unwrap_or(part.len());
            let (place, rest) = part.split_at(end);
            let origin = self.offset(place).map(|offset| self.origin(Span::at(offset)).0);
            let place = origin.map_or_else(|| place.to_owned(), |span| self.template.place(span.start).to_string());
            text.push_str(&format!(" at {place}{rest}"));
        }
        text
    }

    /// The offset of a place of the problem, like `3:5`.
    fn offset(&self, place: &str) -> Option<usize> {
        let (line, column) = place.split_once(':')?;
        let (line, column) = (line.parse::<usize>().ok()?.checked_sub(1)?, column.parse::<usize>().ok()?);
        let lines = self.text.split_inclusive('\n');
        let start = lines.take(line).map(str::len).sum::<usize>();
        let before = self.text.get(start..)?.chars().take(column.checked_sub(1)?);
        Some(start + before.map(char::len_utf8).sum::<usize>())
    }
}

/// The hint on a goal with names in single quotes, each of which is wrong in the same way.
const SINGLE_QUOTES: &str = "names of several words are written in double quotes, not in single ones";

/// The start of a text that may be long, on one line.
fn excerpt(text: &str) -> String {
    text.chars().take(120).map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// `from document _id 7 of robmem.worldmodel`.
pub(super) fn from_document(namespace: &Namespace, id: &Bson) -> String {
    let mut text = String::new();
    match id {
        Bson::ObjectId(id) => text = id.to_hex(),
        other => crate::formats::shell::write_relaxed(other, &mut text),
    }
    format!("from document _id {text} of {namespace}")
}
