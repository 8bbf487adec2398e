//! Mistakes that the engine finds, in the words and at the places of the template as it was written.

use minijinja::{Error, ErrorKind};

use super::context::Context;
use super::files::Files;
use super::hint::Mistake;
use super::{blocks, hint};
use crate::formats::{Diagnostic, Span};
use crate::problem::ProblemError;

/// What went wrong, at its place in the template as it was written.
pub(super) fn explain(files: &Files, context: &Context, error: &Error) -> ProblemError {
    // The innermost error knows the place; the ones around it say which block or macro it was in.
    let mut innermost = error;
    while let Some(inner) = std::error::Error::source(innermost).and_then(|source| source.downcast_ref::<Error>()) {
        innermost = inner;
    }
    let placed = if innermost.range().is_some() { innermost } else { error };
    let range = placed.range().unwrap_or(0..0);
    let Some((template, instrumented)) = files.of(placed.name()) else {
        return ProblemError::Template(files.texts.complain(Span::default(), error.to_string()));
    };
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
    let span = Span::new(span.start - base, span.end.saturating_sub(base));
    if let Some(failure) = context.failure() {
        return ProblemError::store(template, span, failure);
    }
    let is_block = |detail: &str| detail.contains("end of input") || detail.contains("unknown statement end");
    if innermost.kind() == ErrorKind::SyntaxError
        && innermost.detail().is_some_and(is_block)
        && let Some(unclosed) = blocks::unclosed(template)
    {
        return ProblemError::Template(unclosed);
    }
    let expression = template.slice(span).trim().trim_matches(['{', '}', '-']).trim();
    let detail = innermost.detail().unwrap_or_default();
    let missing =
        context.missing().filter(|missing| expression.trim_end_matches(['"', '\'', ']']).ends_with(&missing.key));
    let message = match innermost.kind() {
        ErrorKind::UnknownFilter if !detail.contains("safe") => format!("unknown filter `{}`", hint::quoted(detail)),
        ErrorKind::UnknownTest => format!("unknown test `{}`", hint::quoted(detail)),
        ErrorKind::UnknownFunction => format!("unknown function `{}`", detail.trim_end_matches(" is unknown")),
        ErrorKind::UndefinedError if detail.starts_with('`') => detail.to_owned(),
        ErrorKind::UndefinedError if !expression.is_empty() && !expression.contains('\n') => {
            format!("`{expression}` is undefined")
        }
        ErrorKind::TemplateNotFound => {
            "there is no such template; one that is included is named in quotes, in the tag itself".to_owned()
        }
        ErrorKind::OutOfFuel => "the template does not come to an end".to_owned(),
        ErrorKind::UnknownFilter if detail.contains("safe") => {
            "there is no filter `safe`: values are always names or numbers".to_owned()
        }
        kind if detail.is_empty() => kind.to_string(),
        ErrorKind::InvalidOperation => detail.to_owned(),
        kind => format!("{kind}: {detail}"),
    };
    let code = template.text().get(span.start..).unwrap_or_default();
    let mistake = Mistake { error: innermost, template: template.text(), expression, code, missing: missing.as_ref() };
    let hints = hint::hints(&mistake);
    let diagnostic = Diagnostic::new(template, span, message);
    ProblemError::Template(hints.into_iter().fold(diagnostic, Diagnostic::hint))
}
