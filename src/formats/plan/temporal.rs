//! Temporal planners: LPG, POPF, OPTIC, and plan files with times.
//!
//! Several plans may follow each other, each better than the one before.

use pest::Parser as _;
use pest::iterators::{Pair, Pairs};

use super::lines::{Line, SENTENCE, complain, lines};
use super::transcript::{Action, Complaint, Counted, Transcript, Verdict};
use crate::formats::{Diagnostic, Source, Span};

use grammar::{Grammar, Rule};

mod grammar {
    #[derive(pest_derive::Parser)]
    #[grammar = "grammars/temporal.pest"]
    pub(super) struct Grammar;
}

/// Reads a plan file with times.
///
/// # Errors
///
/// A line that is not timed steps and a comment, at its place.
pub(super) fn read_steps(source: &Source, counted: Counted) -> Result<Vec<Action>, Diagnostic> {
    let mut plans = Plans::new(counted);
    for line in lines(source.text()) {
        let parsed = Grammar::parse(Rule::line, line.text).map_err(|error| complain(source, line, &error, word))?;
        if let Some(span) = endless(parsed.clone(), line) {
            return Err(Diagnostic::new(source, span, "expected a time, found a number too large for one"));
        }
        plans.line(parsed, line);
    }
    Ok(plans.actions)
}

/// The first time in a line that is too large to be one.
fn endless(parsed: Pairs<'_, Rule>, line: Line<'_>) -> Option<Span> {
    let times = parsed.flatten().filter(|part| matches!(part.as_rule(), Rule::start | Rule::duration));
    let too_large = |time: &Pair<'_, Rule>| time.as_str().parse::<f64>().is_ok_and(f64::is_infinite);
    let time = times.into_iter().find(too_large)?.as_span();
    Some(Span::new(line.offset + time.start(), line.offset + time.end()))
}

/// Reads what a temporal planner printed, and the plan files it left, the last of
/// them the best. Where there is a file with a plan, the file is taken: LPG's
/// standard output leaves out the gaps between actions.
#[must_use]
pub fn read(plans: &[Source], stdout: &str, stderr: &str) -> Transcript {
    let mut transcript = remarks(stdout, stderr);
    let filed =
        plans.iter().rev().find_map(|plan| read_steps(plan, Counted::Last).ok().filter(|actions| !actions.is_empty()));
    if let Some(actions) = filed {
        return Transcript { verdict: Verdict::Plan, actions, message: String::new(), complaint: None, ..transcript };
    }
    for line in plans.iter().flat_map(|plan| plan.text().lines()).filter(|line| line.len() <= SENTENCE) {
        remark(&mut transcript, line);
    }
    transcript
}

fn remarks(stdout: &str, stderr: &str) -> Transcript {
    let mut transcript = Transcript::unclear();
    let mut plans = Plans::new(Counted::Last);
    let mut expected = false;
    for line in lines(stdout).chain(lines(stderr)).filter(|line| line.text.len() <= SENTENCE) {
        if std::mem::take(&mut expected) {
            transcript.explain(line.text);
            continue;
        }
        match Grammar::parse(Rule::line, line.text) {
            Ok(parsed) if line.text.contains('(') && !line.text.trim_start().starts_with(';') => {
                plans.line(parsed, line)
            }
            _ => {
                plans.gap(line.text);
                expected = remark(&mut transcript, line.text);
            }
        }
    }
    if !plans.actions.is_empty() {
        transcript.verdict = Verdict::Plan;
        transcript.message.clear();
        transcript.complaint = None;
        transcript.actions = plans.actions;
    }
    transcript
}

/// Takes what a sentence says; true where the next line belongs to it.
fn remark(transcript: &mut Transcript, text: &str) -> bool {
    let Some(remark) = Grammar::parse(Rule::remark, text).ok().and_then(|mut pairs| pairs.next()?.into_inner().next())
    else {
        return false;
    };
    match remark.as_rule() {
        Rule::empty => transcript.decide(Verdict::Plan, ""),
        Rule::unsolvable => transcript.decide(Verdict::Unsolvable, text),
        Rule::unreachable | Rule::none => transcript.decide(Verdict::GaveUp, text),
        Rule::complaint => transcript.reject(Complaint { text: text.trim().to_owned(), ..Complaint::default() }),
        Rule::heading => transcript.cost = cost(remark).or(transcript.cost),
        Rule::syntax_error => {
            let first = transcript.verdict == Verdict::Unclear;
            transcript.reject(syntax_error(&remark));
            return first;
        }
        _ => {}
    }
    false
}

/// The plans of a text, of which all steps count or those of the last one.
///
/// A new plan starts where, after a gap, time goes back to the start of the plan so
/// far: before it, or, after a sentence that announces a plan, to the same moment. It also starts where the first step
/// comes again at its own time.
struct Plans {
    counted: Counted,
    actions: Vec<Action>,
    gap: bool,
    announced: bool,
}

impl Plans {
    fn new(counted: Counted) -> Self {
        Self { counted, actions: Vec::new(), gap: false, announced: false }
    }

    fn gap(&mut self, text: &str) {
        let heading = Grammar::parse(Rule::remark, text)
            .ok()
            .and_then(|mut pairs| pairs.next()?.into_inner().next())
            .is_some_and(|remark| remark.as_rule() == Rule::heading);
        self.gap = true;
        self.announced |= heading;
    }

    fn line<'a>(&mut self, parsed: impl Iterator<Item = Pair<'a, Rule>>, line: Line<'_>) {
        let mut steps = 0;
        for part in parsed.flat_map(Pair::into_inner).filter(|part| part.as_rule() == Rule::step) {
            if let Some(action) = action(part, line) {
                self.push(action);
                steps += 1;
            }
        }
        if steps == 0 {
            self.gap(line.text);
        }
    }

    fn push(&mut self, action: Action) {
        if self.counted == Counted::Last && self.begins(&action) {
            self.actions.clear();
        }
        (self.gap, self.announced) = (false, false);
        self.actions.push(action);
    }

    /// Whether another plan begins with a step.
    fn begins(&self, action: &Action) -> bool {
        let first = self.actions.first().and_then(|first| first.start).zip(action.start);
        let last = self.actions.last().and_then(|last| last.start).zip(action.start);
        let back = last.is_some_and(|(last, start)| start < last) && first.is_some_and(|(first, start)| start <= first);
        let again = self.announced && first.is_some_and(|(first, start)| start <= first);
        // Several steps of one action at one time are steps of one plan.
        let is_later = self.gap || last.is_some_and(|(last, start)| start < last);
        let is_repeated = is_later && self.actions.first().is_some_and(|first| is_same(first, action));
        self.gap && (back || again) || is_repeated
    }
}

/// Whether two steps are the same happening.
fn is_same(one: &Action, other: &Action) -> bool {
    let same = |one: &str, other: &str| one.eq_ignore_ascii_case(other);
    one.start == other.start
        && same(&one.name, &other.name)
        && one.arguments.len() == other.arguments.len()
        && one.arguments.iter().zip(&other.arguments).all(|(one, other)| same(one, other))
}

fn action(step: Pair<'_, Rule>, line: Line<'_>) -> Option<Action> {
    let (mut names, mut start, mut duration) = (Vec::new(), None, None);
    for part in step.into_inner() {
        match part.as_rule() {
            Rule::name => names.push(part.as_str().to_owned()),
            Rule::start => start = part.as_str().parse().ok(),
            Rule::duration => duration = part.as_str().parse().ok(),
            _ => {}
        }
    }
    let mut names = names.into_iter();
    let name = names.next()?;
    Some(Action { name, arguments: names.collect(), start, duration, line: line.number })
}

fn cost(heading: Pair<'_, Rule>) -> Option<f64> {
    let cost = heading.into_inner().find(|part| part.as_rule() == Rule::cost)?;
    cost.into_inner().find(|part| part.as_rule() == Rule::number)?.as_str().parse().ok()
}

fn syntax_error(remark: &Pair<'_, Rule>) -> Complaint {
    let word = |rule| remark.clone().into_inner().find(|part| part.as_rule() == rule).map(|part| part.as_str());
    Complaint::syntax_error(word(Rule::file), word(Rule::integer), word(Rule::quoted))
}

/// Whether a line starts like a timed step.
pub(super) fn is_step(text: &str) -> bool {
    let text = text.trim_start();
    let digits = text.find(|c: char| !c.is_ascii_digit() && !"+-.eE".contains(c)).unwrap_or(text.len());
    digits > 0 && text.get(digits..).is_some_and(|rest| rest.trim_start().starts_with(':') && rest.contains('('))
}

/// Rules in the user's words.
fn word(rule: &Rule) -> &'static str {
    match rule {
        Rule::step | Rule::line => "`TIME: (action argument …) [DURATION]`",
        Rule::name => "a name",
        Rule::duration => "a duration",
        Rule::start | Rule::number => "a time",
        Rule::open => "`(`",
        Rule::close => "`)`",
        Rule::end => "`]`",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn starts(text: &str) -> Vec<f64> {
        read(&[], text, "").actions.iter().filter_map(|action| action.start).collect()
    }

    #[test]
    fn the_last_of_several_plans_is_taken() {
        let text = "; Plan found with metric 9\n0.000: (a) [1.000]\n1.001: (b) [1.000]\n\n\
                    ; Plan found with metric 3\n; Time 0.02\n0.000: (c) [1.000]\n";
        assert_eq!(starts(text), [0.0]);
        assert_eq!(read(&[], text, "").actions[0].name, "c");
    }

    #[test]
    fn a_comment_within_a_plan_does_not_end_it() {
        assert_eq!(starts("0.0: (a) [1]\n; meanwhile\n0.0: (b) [1]\n2: (c) [1]\n"), [0.0, 0.0, 2.0]);
        assert_eq!(starts("0.0: (a) [1]\n\n1.0: (b) [1]\n"), [0.0, 1.0]);
    }

    #[test]
    fn reads_the_three_ways_of_lpg() {
        for text in ["0.0002:   (GO A B) [5.0000])", " 0.0000: (go a b) [D:5.00; C:1.00]", "0:   (GO A B) [5]"] {
            let transcript = read(&[], text, "");
            assert_eq!(transcript.actions[0].duration, Some(5.0), "{text}");
            assert_eq!(transcript.actions[0].arguments.len(), 2);
        }
    }

    #[test]
    fn a_step_that_is_cut_off_is_an_error_at_its_place() {
        let error = read_steps(&Source::new("plan", "0.001: (move r1 a b) [5.000]\n5.002: (move r1"), Counted::All)
            .unwrap_err();
        assert_eq!(error.position(), (2, 16));
        let error = read_steps(&Source::new("plan", "0.001: (move r1 a b) [five]"), Counted::All).unwrap_err();
        assert_eq!(error.position(), (1, 23), "{error}");
    }
}
