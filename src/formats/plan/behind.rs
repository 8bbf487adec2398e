//! A plan behind what a planner printed: of several plans the last counts, in whichever spelling it is.

use super::file::{PlanFile, Spelling, plan_file, wrong};
use super::lines::{Line, SENTENCE, lines};
use super::transcript::{Counted, Transcript};
use super::{downward, ff, temporal};
use crate::formats::{Diagnostic, Source};

/// The last plan of a planner's output, of which `plan` is what the planner itself says.
///
/// # Errors
///
/// A line that looks like a step of the plan and is not spelled as one; a plan behind whose beginning is missing.
pub(super) fn last(source: &Source, plan: PlanFile) -> Result<PlanFile, Diagnostic> {
    if let Some(line) = unbracketed(source, &plan) {
        let message = "expected `TIME: (action argument …) [DURATION]`, found a step without brackets";
        return Err(wrong(source, line, message));
    }
    let is_step = |line: &Line<'_>| is_step(line.text) && !ff::is_pseudo_step(line.text);
    let end = end(source, &plan);
    let steps: Vec<Line<'_>> = lines(source.text()).skip(end).filter(is_step).collect();
    let Some(first) = steps.first() else { return Ok(plan) };
    if ff::is_step(first.text) && !temporal::is_step(first.text) && !begins(first.text) {
        let message = "expected a step like those before, or step 0 of another plan";
        return Err(wrong(source, *first, message));
    }
    let kept = |line: &Line<'_>| line.number > end && (is_step(line) || is_comment(line.text));
    let blank = |line: Line<'_>| if kept(&line) { line.text.to_owned() } else { " ".repeat(line.text.len()) };
    let text = lines(source.text()).map(blank).collect::<Vec<_>>().join("\n");
    let skipped = source.text().len() - text.len();
    // The byte order mark, which is no part of the first line.
    let behind = plan_file(&Source::new(source.name(), " ".repeat(skipped) + &text), Counted::Last)?;
    Ok(PlanFile { is_printed: true, ..behind })
}

/// A run's transcript, with the last plan of what was printed.
pub(super) fn last_of_run(stdout: &str, run: Transcript) -> Transcript {
    let is_timed = run.actions.iter().any(|action| action.start.is_some());
    let spelling = if is_timed { Spelling::Temporal } else { Spelling::Ff };
    let plan = PlanFile { spelling, actions: run.actions.clone(), cost: run.cost, is_printed: true };
    match last(&Source::new("<stdout>", stdout), plan) {
        Ok(plan) => Transcript { actions: plan.actions, cost: plan.cost, ..run },
        Err(error) => Transcript { message: error.to_string(), ..Transcript::unclear() },
    }
}

/// The last line of the plan that the planner itself says.
fn end(source: &Source, plan: &PlanFile) -> usize {
    let found = || lines(source.text()).filter(|line| line.text.to_lowercase().contains("solution found"));
    let last = plan.actions.iter().map(|action| action.line).max();
    last.or_else(|| found().last().map(|line| line.number)).unwrap_or(0)
}

/// A step of a plan with times that has no brackets, among those that have some, or right before them.
fn unbracketed<'a>(source: &'a Source, plan: &PlanFile) -> Option<Line<'a>> {
    let first = plan.actions.first().filter(|_| plan.spelling == Spelling::Temporal)?.line;
    let is_bare = |line: &Line<'_>| {
        let number = line.text.trim_start().split_once(':').filter(|_| !line.text.contains('('));
        number.is_some_and(|(number, step)| {
            number.trim().parse::<f64>().is_ok() && step.trim_start().starts_with(|c: char| c.is_alphabetic())
        })
    };
    lines(source.text()).skip(first.saturating_sub(2)).find(is_bare)
}

/// Whether a line is a step, in any spelling.
fn is_step(text: &str) -> bool {
    let is_numbered = || text.contains(':') && ff::is_step(text) && !ff::is_found(text);
    text.len() <= SENTENCE && (downward::is_step(text) || temporal::is_step(text) || is_numbered())
}

fn is_comment(text: &str) -> bool {
    text.trim_start().starts_with(';')
}

/// Whether a step of FF is the first of a plan.
fn begins(text: &str) -> bool {
    let number = text.trim_start().trim_start_matches("step").trim_start().split(':').next();
    number.is_some_and(|number| number.trim() == "0")
}
