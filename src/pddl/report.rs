//! Complaints collected on the way: several at once, but not without end.

use crate::formats::pddl::{Foreign, other_language, tight_dashes};
use crate::formats::{Diagnostic, Source, Span};

/// How many errors, and how many warnings, are kept.
const LIMIT: usize = 50;

/// What is wrong and what is odd about one text.
pub(super) struct Report<'a> {
    source: &'a Source,
    pub(super) errors: Vec<Diagnostic>,
    pub(super) warnings: Vec<Diagnostic>,
}

impl<'a> Report<'a> {
    pub(super) fn new(source: &'a Source) -> Self {
        Self { source, errors: Vec::new(), warnings: Vec::new() }
    }

    /// Whether further errors would not be kept; then there is no need to think about their hints.
    pub(super) fn is_full(&self) -> bool {
        self.errors.len() >= LIMIT
    }

    /// Line and column, for a hint that points elsewhere.
    pub(super) fn position(&self, span: Span) -> String {
        let (line, column) = self.source.position(span.start);
        format!("{line}:{column}")
    }

    pub(super) fn error(&mut self, span: Span, message: impl Into<String>) {
        self.error_with(span, message, String::new());
    }

    /// With a hint, unless that is empty.
    pub(super) fn error_with(&mut self, span: Span, message: impl Into<String>, hint: String) {
        if !self.is_full() {
            self.errors.push(with_hint(Diagnostic::new(self.source, span, message), hint));
        }
    }

    /// Something that is not there, with a hint unless that is empty.
    pub(super) fn missing(&mut self, span: Span, message: impl Into<String>, hint: String) {
        if !self.is_full() {
            self.errors.push(with_hint(Diagnostic::new(self.source, span, message), hint).missing());
        }
    }

    pub(super) fn warning(&mut self, span: Span, message: impl Into<String>) {
        if self.warnings.len() < LIMIT {
            self.warnings.push(Diagnostic::new(self.source, span, message));
        }
    }

    /// Warns of types whose dash has no blank behind it.
    pub(super) fn warn_of_dashes(&mut self) {
        for span in tight_dashes(self.source) {
            let word = self.source.slice(span).to_owned();
            let kind = word.trim_start_matches('-');
            self.warning(span, format!("`{word}` is read as the type `- {kind}`; write a blank behind the dash"));
        }
    }

    /// The warnings, if nothing was wrong; in the order of the text.
    pub(super) fn finish(mut self) -> Result<Vec<Diagnostic>, Vec<Diagnostic>> {
        self.errors.sort_by_key(Diagnostic::span);
        self.warnings.sort_by_key(Diagnostic::span);
        if self.errors.is_empty() { Ok(self.warnings) } else { Err(self.errors) }
    }
}

/// What is wrong with a text, or that it uses a part of another language of planning.
pub(super) fn foreign_or(source: &Source, wrong: Vec<Diagnostic>) -> Vec<Diagnostic> {
    match other_language(source) {
        None => wrong,
        Some(Foreign { span, what, hint }) => {
            let message = format!("no planner of rmem can handle {what}");
            vec![Diagnostic::new(source, span, message).hint(hint).unsupported()]
        }
    }
}

fn with_hint(diagnostic: Diagnostic, hint: String) -> Diagnostic {
    if hint.is_empty() { diagnostic } else { diagnostic.hint(hint) }
}
