//! What is asked for, and what can go wrong.

use bson::{Bson, Document};

use crate::fault::{AtFault, Fault};
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::store::{Namespace, StoreError};

/// The spelling of a template.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Syntax {
    /// Recognised by the content.
    #[default]
    Auto,
    /// `{{ … }}` and `{% … %}`.
    Minijinja,
    /// `<<key>>` and `<<#NAME|{query}>>`, as in Fawkes.
    Marker,
}

/// A template that another one includes, extends or imports.
#[derive(Debug, Clone, PartialEq)]
pub struct TemplatePart {
    /// As it is named there.
    pub name: String,
    /// Its text, which goes by its path.
    pub source: Source,
}

/// A problem wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The template.
    pub template: Source,
    /// The templates that it names.
    pub parts: Vec<TemplatePart>,
    /// Its spelling.
    pub syntax: Syntax,
    /// What the sections of the marker spelling query.
    pub collection: Namespace,
    /// PDDL text for `goal` and `<<GOAL>>`; several expressions are joined by `and`.
    pub goal: Option<String>,
    /// Variables of the template, by name. They are values, never PDDL text.
    pub parameters: Vec<(String, Bson)>,
    /// In the marker spelling, what has no value becomes empty, as in Fawkes, instead of an error.
    pub lenient: bool,
}

/// A query of the template and what it gave.
#[derive(Debug, Clone, PartialEq)]
pub struct SectionReport {
    /// The section's name, or the call in the template.
    pub name: String,
    /// What was queried.
    pub namespace: Namespace,
    /// The query: a filter, `{pipeline: […]}`, or `{distinct: field, query: …}`.
    pub query: Document,
    /// How many documents (or distinct values) the template took from it, over all times it was asked.
    pub matched: u64,
    /// The template, where it is one that the template names.
    pub part: Option<String>,
    /// The line of the template, from 1.
    pub line: usize,
    /// The column there, from 1.
    pub column: usize,
    /// That it matches no document, at its place: the error where that is one.
    pub unmatched: Diagnostic,
}

impl SectionReport {
    /// Returns where it stands: `line 5`, or `line 5 of part.j2`.
    #[must_use]
    pub fn place(&self) -> String {
        let of = self.part.as_ref().map(|part| format!(" of {part}")).unwrap_or_default();
        format!("line {}{of}", self.line)
    }

    /// Says what was asked, and how many documents answered.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Self { name, namespace, matched, .. } = self;
        let plural = if *matched == 1 { "document" } else { "documents" };
        format!("{}: {name} asks {} in {namespace}: {matched} {plural}", self.place(), shell::relaxed(&self.query))
    }

    /// Returns the filter that documents had to match; of a pipeline, the `$match` in front.
    #[must_use]
    pub fn filter(&self) -> Option<Document> {
        if let Ok(stages) = self.query.get_array("pipeline") {
            let first = stages.first().and_then(Bson::as_document)?;
            return first.get_document("$match").ok().cloned();
        }
        let inner = self.query.get_document("query").ok().filter(|_| self.query.contains_key("distinct"));
        Some(inner.unwrap_or(&self.query).clone())
    }
}

/// Why there is no problem.
#[derive(Debug, thiserror::Error)]
pub enum ProblemError {
    /// The template, a query in it, the goal or a parameter is wrong.
    #[error(transparent)]
    Template(#[from] Diagnostic),
    /// The store failed while it answered.
    #[error("{error}")]
    Store {
        /// The place in the template, like `t.j2:3:5`.
        place: String,
        /// The store's error.
        #[source]
        error: StoreError,
    },
}

impl AtFault for ProblemError {
    fn fault(&self) -> Fault {
        match self {
            Self::Template(error) => error.fault(),
            Self::Store { error, .. } => error.fault(),
        }
    }
}

impl ProblemError {
    /// A store's complaint about the query at `span`: the template's fault if the query is bad.
    pub(super) fn store(source: &Source, span: Span, error: StoreError) -> Self {
        match error {
            StoreError::Query(error) if error.fault() == Fault::Input => {
                Self::Template(Diagnostic::new(source, span, error.message))
            }
            error => {
                let (line, column) = source.position(span.start);
                Self::Store { place: format!("{}:{line}:{column}", source.name()), error }
            }
        }
    }
}
