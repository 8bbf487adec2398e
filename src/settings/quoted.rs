//! Strings of `rmem.toml` that hold queries or pipelines, and the places of mistakes in them.

use std::ops::Range;

use toml::Spanned;

use crate::formats::{Diagnostic, Source};
use crate::query::QueryError;

/// A mistake in `rmem.toml`: its place and its description.
pub(super) type Mistake = (Range<usize>, String);

/// A string of the file that holds a query or a pipeline.
pub(super) struct Quoted<'a> {
    pub(super) string: &'a Spanned<String>,
    pub(super) file: &'a str,
}

impl Quoted<'_> {
    pub(super) fn source(&self) -> Source {
        Source::new("rmem.toml", self.string.get_ref().as_str())
    }

    /// Returns the mistake for a syntax error.
    pub(super) fn syntax(&self, what: &str, error: &Diagnostic) -> Mistake {
        let span = error.span();
        (self.place(span.start..span.end), format!("{what}: {}", error.message()))
    }

    /// Returns the mistake for a query that is refused.
    pub(super) fn refused(&self, what: &str, error: &QueryError) -> Mistake {
        let place = error.place(self.string.get_ref());
        (place.map_or_else(|| self.string.span(), |part| self.place(part)), format!("{what}: {}", error.message))
    }

    /// Returns the place of a part of the text in the file; the whole string, if escapes precede the part.
    fn place(&self, part: Range<usize>) -> Range<usize> {
        let whole = self.string.span();
        let written = self.file.get(whole.clone()).unwrap_or_default();
        let long = ["\"\"\"\r\n", "\"\"\"\n", "\"\"\"", "'''\r\n", "'''\n", "'''", "\"", "'"];
        let Some(mark) = long.into_iter().find(|mark| written.starts_with(mark)) else { return whole };
        let is_there = |front: &str| written.get(mark.len()..).is_some_and(|rest| rest.starts_with(front));
        match self.string.get_ref().get(..part.end) {
            Some(front) if is_there(front) => {
                let start = whole.start + mark.len();
                start + part.start..start + part.end
            }
            _ => whole,
        }
    }
}
