//! Plan files, in whichever of the three spellings.

use super::transcript::{Action, Counted};
use super::{downward, ff, lines, temporal};
use crate::formats::{Diagnostic, Source, Span};

/// How a plan file is spelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Spelling {
    /// `step    0: MOVE R2 K L`, as FF prints it.
    Ff,
    /// `(move r2 k l)`, as in the planning competitions.
    Ipc,
    /// `0.001: (move r2 k l) [5.000]`.
    Temporal,
}

/// A plan as it stands in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanFile {
    /// How it is spelled.
    pub spelling: Spelling,
    /// The actions, in the order of the file.
    pub actions: Vec<Action>,
    /// What `; cost = N` or `plan cost: N` says.
    pub cost: Option<f64>,
    /// Whether it stood in the output of a planner, and not in a file of its own.
    pub is_printed: bool,
}

/// A text that is a plan file, or what FF prints.
pub(super) fn plan_file(source: &Source, counted: Counted) -> Result<PlanFile, Diagnostic> {
    match spelling(source.text()) {
        Spelling::Ff => read_ff(source),
        Spelling::Ipc => {
            let steps = downward::read_steps(source, counted)?;
            Ok(PlanFile { spelling: Spelling::Ipc, actions: steps.actions, cost: steps.cost, is_printed: false })
        }
        Spelling::Temporal => {
            let actions = temporal::read_steps(source, counted)?;
            Ok(PlanFile { spelling: Spelling::Temporal, actions, cost: None, is_printed: false })
        }
    }
}

fn spelling(text: &str) -> Spelling {
    if text.lines().any(ff::is_found) {
        return Spelling::Ff;
    }
    let first = lines::lines(text).map(|line| line.text.trim()).find(|line| !line.is_empty() && !line.starts_with(';'));
    match first {
        Some(line) if temporal::is_step(line) => Spelling::Temporal,
        Some(line) if ff::is_step(line) => Spelling::Ff,
        _ => Spelling::Ipc,
    }
}

/// FF's steps, within FF's output or alone.
fn read_ff(source: &Source) -> Result<PlanFile, Diagnostic> {
    let text = source.text();
    if text.lines().any(ff::is_found) {
        let (transcript, gap) = ff::read_noting(text, "");
        if let Some(ff::Gap { line, message }) = gap {
            let line = lines::lines(text).nth(line.saturating_sub(1));
            return Err(line.map_or_else(
                || Diagnostic::new(source, Span::default(), message.as_str()),
                |line| wrong(source, line, &message),
            ));
        }
        let timed = transcript.actions.iter().any(|action| action.start.is_some());
        let spelling = if timed { Spelling::Temporal } else { Spelling::Ff };
        return Ok(PlanFile { spelling, actions: transcript.actions, cost: transcript.cost, is_printed: true });
    }
    let (mut actions, mut numbers) = (Vec::new(), ff::Numbers::default());
    for line in lines::lines(text) {
        let line_text = line.text.trim();
        if line_text.is_empty() || line_text.starts_with(';') {
            continue;
        }
        match ff::step_of(line.text, line.number, &mut numbers) {
            Some(Ok((numbered, action))) => {
                if numbered == ff::Numbered::Again {
                    actions.clear();
                }
                actions.extend(action);
            }
            Some(Err(gap)) => return Err(wrong(source, line, &gap.message)),
            None => return Err(wrong(source, line, "expected a step as FF writes it: `1: ACTION ARGUMENT …`")),
        }
    }
    Ok(PlanFile { spelling: Spelling::Ff, actions, cost: None, is_printed: false })
}

/// Complains about a line.
pub(super) fn wrong(source: &Source, line: lines::Line<'_>, message: &str) -> Diagnostic {
    let text = line.text.trim();
    let start = line.offset + line.text.len() - line.text.trim_start().len();
    Diagnostic::new(source, Span::new(start, start + text.len()), message)
}
