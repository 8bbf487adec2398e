//! Texts of other languages in strings of `rmem.toml`, and where in the file they are wrong.

use std::ops::Range;

use toml::Spanned;

use crate::formats::{Diagnostic, Source};
use crate::query::QueryError;

/// What is wrong, and where.
type Complaint = (Range<usize>, String);

/// A string of the file that has a text of another language in it.
pub(super) struct Quoted<'a> {
    pub(super) string: &'a Spanned<String>,
    pub(super) file: &'a str,
}

impl Quoted<'_> {
    pub(super) fn source(&self) -> Source {
        Source::new("rmem.toml", self.string.get_ref().as_str())
    }

    /// What is wrong with the text as such.
    pub(super) fn unread(&self, what: &str, error: &Diagnostic) -> Complaint {
        let span = error.span();
        (self.place(span.start..span.end), format!("this is {what}: {}", error.message()))
    }

    /// What is wrong with its meaning.
    pub(super) fn refused(&self, what: &str, error: &QueryError) -> Complaint {
        let place = error.place(self.string.get_ref());
        (
            place.map_or_else(|| self.string.span(), |part| self.place(part)),
            format!("this is {what}: {}", error.message),
        )
    }

    /// Where a part of the text is in the file; the whole string, where escapes are in front of it.
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
