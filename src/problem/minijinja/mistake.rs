//! Mistakes that minijinja finds, in the words and at the places of the template as it was written.

use minijinja::{Error, ErrorKind};

use super::context::Context;
use super::direct::lock;
use super::files::Files;
use super::hint::Mistake;
use super::instrument::Instrumented;
use super::{blocks, hint};
use crate::formats::{Diagnostic, Source, Span};
use crate::problem::ProblemError;
use crate::problem::origin::from_document;

/// What messages about values say that PDDL has no name for.
const UNNAMED: [&str; 3] = ["has no name in PDDL", " is not a name; ", " are not numbers in PDDL"];

/// Whether an error says that a value is undefined, and no more.
fn is_bare_undefined(error: &Error) -> bool {
    error.kind() == ErrorKind::UndefinedError && error.detail().is_none()
}

/// Where the value is that the filter `join` at `span` is for; the filter where it is none.
fn joined(template: &str, span: Span) -> Span {
    let is_join = template.get(span.start..span.end).is_some_and(|filter| filter.starts_with("join"));
    let before = template.get(..span.start).filter(|_| is_join).unwrap_or_default().trim_end();
    let Some(value) = before.strip_suffix('|').map(str::trim_end) else { return span };
    let (mut depth, mut quote, mut start) = (0_usize, None, 0);
    for (at, c) in value.char_indices().rev() {
        match (quote, c) {
            (Some(open), _) if open == c => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, ')' | ']' | '}') => depth += 1,
            (None, '(' | '[' | '{') if depth > 0 => depth -= 1,
            (None, '(' | '[' | '{' | ',' | '=' | '~' | '+') if depth == 0 => {
                start = at + c.len_utf8();
                break;
            }
            (None, _) if depth == 0 && c.is_whitespace() => {
                start = at + c.len_utf8();
                break;
            }
            _ => {}
        }
    }
    Span::new(start, value.len())
}

/// What went wrong, at its place in the template as it was written.
pub(super) fn explain(files: &Files, context: &Context, error: &Error) -> ProblemError {
    let innermost = innermost(error);
    let placed = if innermost.range().is_some() { innermost } else { error };
    let Some((template, instrumented)) = files.of(placed.name()) else {
        return ProblemError::Template(files.texts.complain(Span::default(), error.to_string()));
    };
    let span = place(template, instrumented, context, placed);
    let span = if is_bare_undefined(innermost) { joined(template.text(), span) } else { span };
    if let Some(failure) = context.failure() {
        return ProblemError::store(template, span, failure);
    }
    if is_about_blocks(innermost)
        && let Some(unclosed) = blocks::unclosed(template)
    {
        return ProblemError::Template(unclosed);
    }
    let expression = template.slice(span).trim().trim_matches(['{', '}', '-']).trim();
    let missing =
        context.missing().filter(|missing| expression.trim_end_matches(['"', '\'', ']']).ends_with(&missing.key));
    let code = template.text().get(span.start..).unwrap_or_default();
    let keys = context.looked.keys();
    let missing = missing.as_ref();
    let mistake = Mistake { error: innermost, template: template.text(), expression, code, missing, keys: &keys };
    let diagnostic = Diagnostic::new(template, span, message(innermost, expression));
    let document = is_of_value(innermost).then(|| context.looked.document_of(expression)).flatten();
    let diagnostic = match document.as_deref() {
        Some((namespace, id)) => diagnostic.hint(from_document(namespace, id)),
        None => diagnostic,
    };
    ProblemError::Template(hint::hints(&mistake).into_iter().fold(diagnostic, Diagnostic::hint))
}

/// The innermost error, which knows the place; the ones around it say which block or macro it was in.
fn innermost(error: &Error) -> &Error {
    let mut innermost = error;
    while let Some(inner) = std::error::Error::source(innermost).and_then(|source| source.downcast_ref::<Error>()) {
        innermost = inner;
    }
    innermost
}

/// Where an error is in the template as it was written.
fn place(template: &Source, instrumented: &Instrumented, context: &Context, error: &Error) -> Span {
    let range = error.range().unwrap_or(0..0);
    let base = instrumented.original(0);
    let length = base + template.text().len();
    let start = instrumented.original(range.start).min(length);
    let end = instrumented.original(range.end).clamp(start, length);
    let mut span = Span::new(start, end);
    if instrumented.is_inserted(range.start) {
        // The complaint is about what was added to an expression, so about its value.
        let around = context.sites.iter().filter(|site| site.start <= start && start <= site.end);
        span = around.min_by_key(|site| site.end - site.start).copied().unwrap_or(span);
    }
    let span = context.compared.refused().or(*lock(&context.stopped)).unwrap_or(span);
    Span::new(span.start.saturating_sub(base), span.end.saturating_sub(base))
}

/// Whether an error may come from a block that is not closed.
fn is_about_blocks(error: &Error) -> bool {
    let is_block = |detail: &str| detail.contains("end of input") || detail.contains("unknown statement end");
    error.kind() == ErrorKind::SyntaxError && error.detail().is_some_and(is_block)
}

/// Whether a value of a document is no name.
fn is_of_value(error: &Error) -> bool {
    let detail = error.detail().unwrap_or_default();
    error.kind() == ErrorKind::InvalidOperation && UNNAMED.iter().any(|text| detail.contains(text))
}

/// An error in rmem's words; `expression` is what stands at its place.
fn message(error: &Error, expression: &str) -> String {
    let detail = error.detail().unwrap_or_default();
    match error.kind() {
        ErrorKind::UnknownFilter if detail.contains("safe") => {
            "there is no filter `safe`: values are always names or numbers".to_owned()
        }
        ErrorKind::UnknownFilter => format!("unknown filter `{}`", hint::quoted(detail)),
        ErrorKind::UnknownTest => format!("unknown test `{}`", hint::quoted(detail)),
        ErrorKind::UnknownFunction => format!("unknown function `{}`", detail.trim_end_matches(" is unknown")),
        ErrorKind::UndefinedError if detail.starts_with('`') => detail.to_owned(),
        ErrorKind::UndefinedError if !expression.is_empty() && !expression.contains('\n') => {
            format!("`{expression}` is undefined")
        }
        ErrorKind::TemplateNotFound => "there is no such template".to_owned(),
        ErrorKind::WriteFailure => std::error::Error::source(error)
            .map_or_else(|| "the text cannot be written".to_owned(), ToString::to_string),
        ErrorKind::OutOfFuel => "the template does not come to an end".to_owned(),
        kind if detail.is_empty() => kind.to_string(),
        ErrorKind::InvalidOperation => detail.to_owned(),
        kind => format!("{kind}: {detail}"),
    }
}
