//! Loads a program, part by part, and says at which of its lines CLIPS finds mistakes.

use super::native::{Environment, Stream};
use super::program::{self, Part};
use super::state::{LoadMessage, State};
use crate::formats::{Diagnostic, Source, Span};

/// How deep lists may be nested in a program: CLIPS reads them recursively.
const MAX_DEPTH: usize = 10_000;

/// What came of loading a program.
#[derive(Default)]
pub(super) struct Loaded {
    /// What is wrong with it.
    pub(super) complaints: Vec<Diagnostic>,
    /// Whether one of its commands resets CLIPS.
    pub(super) is_reset: bool,
}

/// Loads the constructs of a program, and runs the commands among them.
pub(super) fn program(program: &Source, clips: &Environment, state: &State<'_>) -> Loaded {
    let mut loaded = Loaded::default();
    if let Some(place) = too_deep(program.text()) {
        let message = format!("expected lists nested at most {MAX_DEPTH} deep");
        loaded.complaints.push(Diagnostic::new(program, Span::at(place), message));
        return loaded;
    }
    for part in program::parts(program.text()) {
        match part {
            Part::Constructs(span) => loaded.complaints.extend(constructs(program, span, clips, state)),
            Part::Command(span) => {
                loaded.is_reset |= program.slice(span).trim_start_matches('(').trim_start().starts_with("reset");
                loaded.complaints.extend(command(program, span, clips, state));
            }
        }
        if state.stop().is_due() {
            break;
        }
    }
    loaded
}

/// Loads constructs; returns what is wrong with them.
fn constructs(program: &Source, span: Span, clips: &Environment, state: &State<'_>) -> Vec<Diagnostic> {
    let mut complaints = Vec::new();
    // CLIPS counts the lines of what it is given.
    let before = program.text().get(..span.start).unwrap_or_default().matches('\n').count();
    let text = format!("{}{}", "\n".repeat(before), program.slice(span));
    let good = state.while_loading(|| clips.load(&text));
    for LoadMessage { line, is_warning, text } in state.take_load_messages() {
        let complaint = Diagnostic::new(program, line_span(program.text(), line), sentence(&text));
        if is_warning {
            state.sender().note(complaint.to_string());
        } else {
            complaints.push(complaint);
        }
    }
    if !good && complaints.is_empty() && !state.stop().is_due() {
        complaints.push(Diagnostic::new(program, Span::at(span.start), "expected constructs that CLIPS can load"));
    }
    complaints
}

/// Runs a command; returns what is wrong with it.
fn command(program: &Source, span: Span, clips: &Environment, state: &State<'_>) -> Option<Diagnostic> {
    let (good, printed) = state.while_commanding(|| clips.command(program.slice(span)));
    let failed = !good || clips.has_failed();
    if state.stop().is_due() {
        return None;
    }
    clips.recover();
    if failed {
        let first = printed.lines().find(|line| !line.trim().is_empty()).unwrap_or("CLIPS cannot run this command");
        return Some(Diagnostic::new(program, span, first.trim()));
    }
    state.sender().write(Stream::Err, printed.as_bytes());
    None
}

/// The message of CLIPS on a mistake, without the construct that it repeats.
fn sentence(text: &str) -> String {
    let text = text.split_once("\nERROR:").map_or(text, |(text, _)| text);
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A line, from 1, without the blanks around it; the last one where there are fewer.
fn line_span(text: &str, line: usize) -> Span {
    let mut start = 0;
    let mut found = Span::at(0);
    for (nth, content) in text.split_inclusive('\n').enumerate() {
        let indent = content.len() - content.trim_start().len();
        if !content.trim().is_empty() {
            found = Span::new(start + indent, start + content.trim_end().len());
        }
        if nth + 1 >= line {
            break;
        }
        start += content.len();
    }
    found
}

/// Where lists are nested too deeply.
fn too_deep(text: &str) -> Option<usize> {
    let (mut depth, mut quoted, mut escaped, mut remark) = (0_usize, false, false, false);
    for (place, byte) in text.bytes().enumerate() {
        match byte {
            _ if escaped => escaped = false,
            b'\n' if remark => remark = false,
            _ if remark => {}
            b'\\' if quoted => escaped = true,
            b'"' => quoted = !quoted,
            _ if quoted => {}
            b';' => remark = true,
            b'(' => depth += 1,
            b')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > MAX_DEPTH {
            return Some(place);
        }
    }
    None
}
