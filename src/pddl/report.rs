//! Complaints collected on the way: several at once, but not without end.

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

    pub(super) fn warning(&mut self, span: Span, message: impl Into<String>) {
        if self.warnings.len() < LIMIT {
            self.warnings.push(Diagnostic::new(self.source, span, message));
        }
    }

    /// The warnings, if nothing was wrong; in the order of the text.
    pub(super) fn finish(mut self) -> Result<Vec<Diagnostic>, Vec<Diagnostic>> {
        self.errors.sort_by_key(Diagnostic::span);
        self.warnings.sort_by_key(Diagnostic::span);
        if self.errors.is_empty() { Ok(self.warnings) } else { Err(self.errors) }
    }
}

fn with_hint(diagnostic: Diagnostic, hint: String) -> Diagnostic {
    if hint.is_empty() { diagnostic } else { diagnostic.hint(hint) }
}
