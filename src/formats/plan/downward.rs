//! Fast Downward: exit codes, plan files, and what it logs.

use pest::Parser as _;
use pest::iterators::Pair;

use super::lines::{Line, SENTENCE, complain, lines};
use super::transcript::{Action, Complaint, Counted, Transcript, Verdict};
use crate::formats::{Diagnostic, Source, Span};

use grammar::{Grammar, Rule};

mod grammar {
    #[derive(pest_derive::Parser)]
    #[grammar = "grammars/downward.pest"]
    pub(super) struct Grammar;
}

/// A plan file's content.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Steps {
    /// The actions in order.
    pub actions: Vec<Action>,
    /// What `; cost = N` says; a file without that line may be truncated.
    pub cost: Option<f64>,
    /// Whether they are spelled as in a log.
    is_logged: bool,
}

impl Steps {
    /// Takes a part of a line. What follows the cost of a plan is another plan where the last one counts, and so are steps of a
    /// plan file behind those of a log, or the other way round.
    fn take(&mut self, part: Pair<'_, Rule>, line: Line<'_>, counted: Counted) {
        match part.as_rule() {
            Rule::step | Rule::logged => {
                let is_logged = part.as_rule() == Rule::logged;
                let is_behind = self.cost.take().is_some() && counted == Counted::Last;
                if is_behind || self.is_logged != is_logged {
                    self.actions.clear();
                }
                self.is_logged = is_logged;
                self.actions.extend(action(part, line));
            }
            Rule::cost => self.cost = number(part),
            _ => {}
        }
    }
}

/// Reads a plan file: steps as `(move r2 k l)`, or as Fast Downward logs them, `move r2 k l (1)`. A last line `; cost
/// = N (unit cost)` gives the cost; whether it has to be there is the caller's business ([`whole`]).
///
/// # Errors
///
/// A line that is not steps and a comment, at its place.
pub(super) fn read_steps(source: &Source, counted: Counted) -> Result<Steps, Diagnostic> {
    let mut steps = Steps::default();
    for line in lines(source.text()) {
        let parsed: Vec<Pair<'_, Rule>> = match Grammar::parse(Rule::line, line.text) {
            Ok(parsed) => parsed.flat_map(Pair::into_inner).collect(),
            Err(error) => match Grammar::parse(Rule::logged, line.text) {
                Ok(logged) => logged.collect(),
                Err(_) => return Err(complain(source, line, &error, word)),
            },
        };
        parsed.into_iter().for_each(|part| steps.take(part, line, counted));
    }
    Ok(steps)
}

/// Reads a plan file that has to be whole: its last line gives the cost.
///
/// # Errors
///
/// As [`read_steps`], and where the cost is missing.
pub(super) fn whole(source: &Source) -> Result<Steps, Diagnostic> {
    let steps = read_steps(source, Counted::Last)?;
    if steps.cost.is_none() {
        let end = Span::at(source.text().trim_end().len());
        return Err(Diagnostic::new(source, end, "expected `; cost = N (unit cost)`, found the end of the text")
            .hint("a plan file without it is truncated"));
    }
    Ok(steps)
}

/// Reads a run: the plan files it left, the last of them the best, its exit code,
/// and what it logged. Without a plan file, steps on standard output count.
#[must_use]
pub fn read(plans: &[Source], code: Option<i32>, stdout: &str, stderr: &str) -> Transcript {
    let (verdict, message) = outcome(code);
    let mut transcript = Transcript { verdict, message: message.to_owned(), ..Transcript::unclear() };
    let printed = last_words(stdout, stderr);
    if !printed.is_empty() && !matches!(verdict, Verdict::Plan) {
        transcript.message = match message {
            "" => printed.clone(),
            _ => format!("{message}: {printed}"),
        };
    }
    if printed.contains("Invalid requirement")
        || printed.contains("does not support")
        || printed.contains("not supported")
    {
        transcript.verdict = Verdict::Unsupported;
    }
    if verdict == Verdict::Rejected {
        transcript.complaint = Some(Complaint { text: printed, ..Complaint::default() });
    }
    if matches!(verdict, Verdict::Plan | Verdict::OutOfTime | Verdict::OutOfMemory | Verdict::Unclear) {
        take_plan(&mut transcript, plans, stdout);
    }
    transcript
}

/// Reads what Fast Downward printed, by itself: the last plan that it found.
pub(super) fn printed(stdout: &str) -> Transcript {
    let start = stdout.rfind("Solution found!");
    let last = start.and_then(|start| stdout.get(start..));
    let lines_before = start.and_then(|start| stdout.get(..start)).map_or(0, |before| before.matches('\n').count());
    let plan = last.and_then(|rest| logged(rest.find("Plan length:").and_then(|end| rest.get(..end)).unwrap_or(rest)));
    let mut transcript = Transcript::unclear();
    match plan.or_else(|| last.map(|_| Steps::default())) {
        Some(mut steps) => {
            steps.actions.iter_mut().for_each(|action| action.line += lines_before);
            found(&mut transcript, steps);
            let cost = last.and_then(|rest| rest.split("Plan cost:").nth(1));
            transcript.cost = cost.and_then(|rest| rest.split_whitespace().next()?.parse().ok());
        }
        None if stdout.contains("Search stopped without finding a solution") || stdout.contains("unsolvable") => {
            transcript.decide(Verdict::Unsolvable, &last_words(stdout, ""));
        }
        None => transcript.message = last_words(stdout, ""),
    }
    transcript
}

/// Takes the best whole plan there is.
fn take_plan(transcript: &mut Transcript, plans: &[Source], stdout: &str) {
    let mut broken = None;
    for plan in plans.iter().rev() {
        match whole(plan) {
            Ok(steps) => return found(transcript, steps),
            Err(error) => broken = broken.or(Some(error)),
        }
    }
    if transcript.verdict != Verdict::Plan {
        return;
    }
    // The log of a search may have a plan file behind it, or several plans.
    let last = Some(printed(stdout)).filter(|printed| printed.verdict == Verdict::Plan);
    let last = last.map(|printed| Steps { actions: printed.actions, cost: printed.cost, ..Steps::default() });
    match (broken, last.or_else(|| logged(stdout))) {
        (None, Some(steps)) => found(transcript, steps),
        (Some(error), _) => {
            transcript.verdict = Verdict::Unclear;
            transcript.message = error.to_string();
        }
        (None, None) => {
            transcript.verdict = Verdict::Unclear;
            transcript.message = "the planner ended well but wrote no plan".to_owned();
        }
    }
}

fn found(transcript: &mut Transcript, steps: Steps) {
    *transcript = Transcript {
        verdict: Verdict::Plan,
        actions: steps.actions,
        cost: steps.cost,
        message: String::new(),
        complaint: None,
    };
}

/// What Fast Downward's exit codes mean (its documentation, "Exit codes").
fn outcome(code: Option<i32>) -> (Verdict, &'static str) {
    match code {
        Some(0..=3) => (Verdict::Plan, ""),
        Some(10 | 11) => (Verdict::Unsolvable, ""),
        Some(12) => (Verdict::GaveUp, "the search was incomplete"),
        Some(20 | 22) => (Verdict::OutOfMemory, ""),
        Some(21 | 23 | 24) => (Verdict::OutOfTime, ""),
        Some(31 | 33 | 36) => (Verdict::Rejected, ""),
        Some(34 | 37) => (Verdict::Unsupported, ""),
        _ => (Verdict::Unclear, ""),
    }
}

/// The steps on standard output: as in a plan file, or as Fast Downward logs them.
fn logged(stdout: &str) -> Option<Steps> {
    let (mut steps, mut seen) = (Steps::default(), false);
    for line in lines(stdout).filter(|line| line.text.len() <= SENTENCE) {
        let plain = Grammar::parse(Rule::line, line.text).into_iter().flatten().flat_map(Pair::into_inner);
        let noted = Grammar::parse(Rule::logged, line.text).into_iter().flatten();
        for part in plain.chain(noted) {
            seen |= matches!(part.as_rule(), Rule::cost | Rule::step | Rule::logged);
            steps.take(part, line, Counted::Last);
        }
    }
    seen.then_some(steps)
}

/// Whether a line has steps as in a plan file, or is one as Fast Downward logs it.
pub(super) fn is_step(text: &str) -> bool {
    let parsed = Grammar::parse(Rule::line, text).into_iter().flatten().flat_map(Pair::into_inner);
    parsed.into_iter().any(|part| part.as_rule() == Rule::step) || Grammar::parse(Rule::logged, text).is_ok()
}

/// What the log says last, without what it says of itself.
fn last_words(stdout: &str, stderr: &str) -> String {
    const OF_ITSELF: [&str; 12] = [
        "INFO",
        "[t=",
        "\t",
        "translate exit code",
        "search exit code",
        "Driver aborting",
        "Peak memory",
        "Parsing",
        "Syntax:",
        "Expected:",
        "Remove intermediate",
        "Translator",
    ];
    let mut words: Vec<&str> = Vec::new();
    for text in [stderr, stdout] {
        let printed = text.lines().rev().filter(|line| !line.trim().is_empty() && line.len() <= SENTENCE);
        let printed = printed.filter(|line| !OF_ITSELF.iter().any(|prefix| line.starts_with(prefix)));
        words.extend(printed.take(2 - words.len().min(2)));
    }
    words.reverse();
    words.join(", ").trim_end_matches('.').to_owned()
}

fn action(step: Pair<'_, Rule>, line: Line<'_>) -> Option<Action> {
    let mut names = step.into_inner().filter(|part| part.as_rule() == Rule::name).map(|name| name.as_str().to_owned());
    let name = names.next()?;
    Some(Action { name, arguments: names.collect(), start: None, duration: None, line: line.number })
}

fn number(cost: Pair<'_, Rule>) -> Option<f64> {
    cost.into_inner().find(|part| part.as_rule() == Rule::number)?.as_str().parse().ok()
}

/// Rules in the user's words.
fn word(rule: &Rule) -> &'static str {
    match rule {
        Rule::step | Rule::open | Rule::line | Rule::logged => "`(action argument …)`",
        Rule::name => "a name",
        Rule::number => "a number",
        Rule::close => "`)`",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_that_is_cut_off_is_an_error_at_its_place() {
        let error = read_steps(&Source::new("plan", "(move r2 k l)\n(move r2 k"), Counted::All).unwrap_err();
        assert_eq!(error.position(), (2, 11));
        assert!(error.message().ends_with("found the end of the text"), "{error}");
    }

    #[test]
    fn a_file_without_its_last_line_is_truncated() {
        let text = "(move r2 k l)\n(pick r2 cup k)\n";
        assert_eq!(whole(&Source::new("plan", text)).unwrap_err().position(), (2, 16));
        assert_eq!(whole(&Source::new("plan", format!("{text}; cost = 2 (unit cost)\n"))).unwrap().cost, Some(2.0));
    }

    #[test]
    fn the_last_whole_plan_is_taken() {
        let plans = [
            Source::new("plan.1", "(a)\n(b)\n; cost = 2 (unit cost)\n"),
            Source::new("plan.2", "(b)\n; cost = 1 (unit cost)\n"),
            Source::new("plan.3", "(b"),
        ];
        let transcript = read(&plans, Some(3), "", "");
        assert_eq!((transcript.verdict, transcript.cost), (Verdict::Plan, Some(1.0)));
    }

    #[test]
    fn a_clean_end_without_a_plan_is_not_a_plan() {
        assert_eq!(read(&[], Some(0), "", "").verdict, Verdict::Unclear);
        assert_eq!(read(&[Source::new("plan", "(a)")], Some(0), "", "").verdict, Verdict::Unclear);
    }

    #[test]
    fn a_crash_is_not_a_plan() {
        assert_eq!(read(&[], None, "", "").verdict, Verdict::Unclear);
        assert_eq!(read(&[], Some(139), "", "").verdict, Verdict::Unclear);
    }

    #[test]
    fn steps_on_standard_output_count_where_there_is_no_file() {
        let transcript = read(&[], Some(0), "Solution found!\nmove r2 k l (1)\npick r2 cup k (1)\nPlan cost: 2\n", "");
        assert_eq!(transcript.verdict, Verdict::Plan);
        assert_eq!(transcript.actions.len(), 2);
    }
}
