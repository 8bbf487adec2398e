//! What is wrong with a text that is no XML.

use super::text::Text;
use crate::formats::Diagnostic;

/// What the parser complains about, at its place.
pub(super) fn explain(text: &Text<'_>, whole: &str, error: &roxmltree::Error) -> Diagnostic {
    let start = offset(whole, error.pos());
    match error {
        roxmltree::Error::InvalidComment(_) => comment(text, whole, start),
        roxmltree::Error::UnexpectedDeclaration(_) => text
            .wrong(start..start, "this is no XML: `<?xml` stands behind something else")
            .hint("it has to be the very beginning of the file; move it there, or remove it"),
        other => {
            let message = other.to_string();
            let message = message.rsplit_once(" at ").map_or(message.as_str(), |(message, _)| message);
            text.wrong(start..start, format!("this is no XML: {message}"))
        }
    }
}

/// A comment that has two hyphens in it, or one at its end.
fn comment(text: &Text<'_>, whole: &str, start: usize) -> Diagnostic {
    const OPEN: &str = "<!--";
    let inner = start + OPEN.len();
    let at = whole.get(inner..).and_then(|rest| rest.find("--")).map_or(start, |at| inner + at);
    text.wrong(at..at + 2, "this is no XML: a comment has `--` in it, which XML allows only in the `-->` at its end")
        .hint("write one hyphen, or a blank between the two")
}

fn offset(text: &str, position: roxmltree::TextPos) -> usize {
    let (row, column) = (position.row.max(1) as usize, position.col.max(1) as usize);
    let start: usize = text.split_inclusive('\n').take(row - 1).map(str::len).sum();
    let line = text.get(start..).unwrap_or_default();
    start + line.char_indices().nth(column - 1).map_or(line.len(), |(at, _)| at)
}
