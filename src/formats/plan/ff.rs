//! What FF says: FF 2.3, Metric-FF 2.1, and the present-day `ff`.
//!
//! FF's exit codes say nothing, and its sentences come on either stream, so the
//! text of both decides.

use pest::Parser as _;
use pest::iterators::Pair;

use super::lines::{Line, SENTENCE, lines};
use super::transcript::{Action, Complaint, Transcript, Verdict};

use grammar::{Grammar, Rule};

mod grammar {
    #[derive(pest_derive::Parser)]
    #[grammar = "grammars/ff.pest"]
    pub(super) struct Grammar;
}

/// The action that some builds of FF add to reach a goal that is not a conjunction.
const PSEUDO_ACTION: &str = "REACH-GOAL";

/// Reads what an FF printed on its standard output and standard error.
#[must_use]
pub fn read(stdout: &str, stderr: &str) -> Transcript {
    read_noting(stdout, stderr).0
}

/// [`read`], and the step whose number is not the next one, where there is one.
pub(super) fn read_noting(stdout: &str, stderr: &str) -> (Transcript, Option<Gap>) {
    let mut reader =
        Reader { transcript: Transcript::unclear(), place: Section::Before, numbers: Numbers::default(), gap: None };
    for line in lines(stdout).chain(lines(stderr)) {
        reader.line(line);
    }
    (reader.transcript, reader.gap)
}

/// A step whose number is not the next one: lines of the plan are missing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Gap {
    /// The line it stands on, from 1.
    pub(super) line: usize,
    /// What is wrong.
    pub(super) message: String,
}

/// The numbers of steps, one after the other: from 0 (or 1) on.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    first: Option<usize>,
    next: usize,
}

/// What the number of a step says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Numbered {
    /// It is the next step.
    Next,
    /// The plan begins again.
    Again,
}

impl Numbers {
    /// Takes the number of a step.
    fn take(&mut self, step: &Pair<'_, Rule>, line: usize) -> Result<Numbered, Gap> {
        let number = step.clone().into_inner().find(|part| part.as_rule() == Rule::integer);
        number.map_or(Ok(Numbered::Next), |number| self.take_text(number.as_str(), line))
    }

    /// Takes the number of a step as it is written.
    fn take_text(&mut self, text: &str, line: usize) -> Result<Numbered, Gap> {
        let number = text.parse::<usize>().ok();
        let numbered = match (number, self.first) {
            (Some(number @ (0 | 1)), None) => {
                self.first = Some(number);
                Numbered::Next
            }
            (Some(number), Some(_)) if number == self.next => Numbered::Next,
            (Some(number), Some(first)) if number == first => Numbered::Again,
            _ => {
                let message = format!("expected step {}, found step {text}; lines of the plan are missing", self.next);
                return Err(Gap { line, message });
            }
        };
        self.next = number.unwrap_or_default() + 1;
        Ok(numbered)
    }
}

/// Where in the output the reader is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Section {
    /// Before the plan, or where there is none.
    Before,
    /// In the plan.
    Plan,
    /// After it, where lines have colons too.
    After,
    /// On the line after a syntax error, which says what was expected.
    Complaint,
}

struct Reader {
    transcript: Transcript,
    place: Section,
    numbers: Numbers,
    gap: Option<Gap>,
}

impl Reader {
    fn line(&mut self, line: Line<'_>) {
        if line.text.len() > SENTENCE {
            return;
        }
        if self.place == Section::Complaint {
            self.place = Section::Before;
            return self.transcript.explain(line.text);
        }
        if let Some((number, action)) = numbered_step(line) {
            if self.place == Section::Plan {
                let numbered = self.numbers.take_text(number, line.number);
                self.take_step(numbered, action);
            }
            return;
        }
        let Some(sentence) = sentence(line.text) else { return };
        match sentence.as_rule() {
            Rule::step | Rule::timed => self.step(sentence, line),
            Rule::found => self.found(),
            Rule::timing => self.leave_plan(),
            Rule::cost => self.cost(sentence),
            _ => self.sentence(sentence, line),
        }
    }

    fn found(&mut self) {
        self.transcript = Transcript { verdict: Verdict::Plan, ..Transcript::unclear() };
        self.place = Section::Plan;
        (self.numbers, self.gap) = (Numbers::default(), None);
    }

    fn leave_plan(&mut self) {
        if self.place == Section::Plan {
            self.place = Section::After;
        }
    }

    fn cost(&mut self, sentence: Pair<'_, Rule>) {
        self.leave_plan();
        self.transcript.cost = inner(sentence, Rule::number).and_then(|number| number.as_str().parse().ok());
    }

    fn step(&mut self, sentence: Pair<'_, Rule>, line: Line<'_>) {
        if self.place != Section::Plan {
            return;
        }
        let numbered = self.numbers.take(&sentence, line.number);
        self.take_step(numbered, action(sentence, line.number));
    }

    fn take_step(&mut self, numbered: Result<Numbered, Gap>, action: Option<Action>) {
        match numbered {
            Ok(Numbered::Next) => {}
            Ok(Numbered::Again) => self.transcript.actions.clear(),
            Err(gap) => {
                self.place = Section::After;
                self.transcript = Transcript { message: gap.message.clone(), ..Transcript::unclear() };
                self.gap = Some(gap);
                return;
            }
        }
        match action {
            Some(action) if action.name.eq_ignore_ascii_case(PSEUDO_ACTION) => {}
            Some(action) => self.transcript.actions.push(action),
            None => {}
        }
    }

    fn sentence(&mut self, sentence: Pair<'_, Rule>, line: Line<'_>) {
        let text = line.text;
        let transcript = &mut self.transcript;
        match sentence.as_rule() {
            Rule::proven | Rule::goal_false | Rule::undefined_goal => transcript.decide(Verdict::Unsolvable, text),
            Rule::goal_true => transcript.decide(Verdict::Plan, ""),
            Rule::capped | Rule::bailed | Rule::no_temporal => transcript.decide(Verdict::GaveUp, text),
            Rule::no_criterion => transcript.decide(Verdict::NoCriterion, text),
            Rule::limit | Rule::unsupported => transcript.decide(Verdict::Unsupported, text),
            Rule::unknown_option => transcript.decide(Verdict::Rejected, text),
            Rule::missing_file => transcript.reject(missing_file(sentence)),
            Rule::parse_error => transcript.reject(parse_error(sentence)),
            Rule::complaint => transcript.reject(Complaint { text: text.trim().to_owned(), ..Complaint::default() }),
            Rule::syntax_error => {
                if transcript.verdict == Verdict::Unclear {
                    self.place = Section::Complaint;
                }
                transcript.reject(syntax_error(&sentence));
            }
            _ => {
                if text.trim_start().starts_with("usage of ff") {
                    transcript.decide(Verdict::Rejected, "the planner printed its usage");
                }
            }
        }
    }
}

/// The number and the action of a line that is a step: plans have many, and each sentence of the grammar takes a while.
fn numbered_step(line: Line<'_>) -> Option<(&str, Option<Action>)> {
    let blank = |c: char| matches!(c, ' ' | '\t' | '\r');
    let text = line.text.trim_matches(blank);
    let text = text.strip_prefix("step").map_or(text, |rest| rest.trim_start_matches(blank));
    let digits = text.bytes().take_while(u8::is_ascii_digit).count();
    let (number, rest) = text.split_at_checked(digits).filter(|(number, _)| !number.is_empty())?;
    let rest = rest.trim_start_matches(blank).strip_prefix(':')?;
    if rest.contains(['(', ')', ';']) {
        return None;
    }
    let mut names = rest.split(blank).filter(|name| !name.is_empty()).map(str::to_owned);
    let action = names.next().map(|name| {
        let arguments = names.collect();
        Action { name, arguments, start: None, duration: None, line: line.number }
    });
    Some((number, action))
}

/// The sentence a line is.
fn sentence(text: &str) -> Option<Pair<'_, Rule>> {
    Grammar::parse(Rule::line, text).ok()?.next()?.into_inner().next()
}

/// The first part of `pair` that is a `rule`.
fn inner(pair: Pair<'_, Rule>, rule: Rule) -> Option<Pair<'_, Rule>> {
    pair.into_inner().find(|part| part.as_rule() == rule)
}

/// The action of a step; none where the step is empty.
pub(super) fn action(step: Pair<'_, Rule>, line: usize) -> Option<Action> {
    let timed = step.as_rule() == Rule::timed;
    let (mut names, mut start, mut duration) = (Vec::new(), None, None);
    for part in step.into_inner() {
        match part.as_rule() {
            Rule::name => names.push(part.as_str().to_owned()),
            Rule::number if timed => start = part.as_str().parse().ok(),
            Rule::duration => duration = part.as_str().parse().ok(),
            _ => {}
        }
    }
    let mut names = names.into_iter();
    let name = names.next()?;
    Some(Action { name, arguments: names.collect(), start, duration, line })
}

fn syntax_error(sentence: &Pair<'_, Rule>) -> Complaint {
    let word = |rule| sentence.clone().into_inner().find(|part| part.as_rule() == rule).map(|part| part.as_str());
    Complaint::syntax_error(word(Rule::file), word(Rule::integer), word(Rule::quoted))
}

fn parse_error(sentence: Pair<'_, Rule>) -> Complaint {
    let mut complaint = Complaint::default();
    for part in sentence.into_inner() {
        match part.as_rule() {
            Rule::which => complaint.file = Some(part.as_str().to_owned()),
            Rule::integer => complaint.line = part.as_str().parse().ok(),
            Rule::rest => complaint.text = part.as_str().trim().to_owned(),
            _ => {}
        }
    }
    complaint
}

fn missing_file(sentence: Pair<'_, Rule>) -> Complaint {
    let file = inner(sentence, Rule::file).map(|file| file.as_str().to_owned());
    Complaint { file, text: "the planner cannot find its input file".to_owned(), ..Complaint::default() }
}

/// Whether a line of a plan file is FF's: `step    0: …` or `        1: …`.
pub(super) fn is_step(text: &str) -> bool {
    sentence(text).is_some_and(|sentence| sentence.as_rule() == Rule::step) || is_found(text)
}

/// Whether a line is the heading of FF's plan.
pub(super) fn is_found(text: &str) -> bool {
    text.contains("found legal plan as follows")
}

/// Whether a line is the step that Metric-FF adds to reach the goal.
pub(super) fn is_pseudo_step(text: &str) -> bool {
    text.trim().rsplit([' ', ':']).next().is_some_and(|word| word.eq_ignore_ascii_case(PSEUDO_ACTION))
}

/// One line of a file with FF's steps: its action, where it has one, and what its number says. None where the line is
/// not a step.
pub(super) fn step_of(
    text: &str,
    line: usize,
    numbers: &mut Numbers,
) -> Option<Result<(Numbered, Option<Action>), Gap>> {
    let step = sentence(text).filter(|sentence| sentence.as_rule() == Rule::step)?;
    let numbered = match numbers.take(&step, line) {
        Ok(numbered) => numbered,
        Err(gap) => return Some(Err(gap)),
    };
    let action = action(step, line).filter(|action| !action.name.eq_ignore_ascii_case(PSEUDO_ACTION));
    Some(Ok((numbered, action)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(text: &str) -> Vec<String> {
        read(text, "")
            .actions
            .iter()
            .map(|action| format!("{} {}", action.name, action.arguments.join(" ")).trim().to_owned())
            .collect()
    }

    #[test]
    fn a_step_is_what_the_grammar_reads() {
        let lines = [
            "step    0: PICK-UP B",
            "   12:GO a  b\t c \r",
            "step",
            "step 3:",
            "4 : a",
            "step5 :x:y z",
            "0.5: (go a) [2]",
            "1: (go a)",
            "1: a;b",
            "1:: a",
            ":",
            "step a: b",
            "stepp 1: a",
            "7",
            "7a: b",
            "time spent:    0.00 seconds",
            "",
            "1: é ü",
            "1:\u{a0}a",
        ];
        for text in lines {
            let line = Line { number: 8, offset: 0, text };
            let read = sentence(text).filter(|sentence| sentence.as_rule() == Rule::step);
            let number =
                |step: &Pair<'_, Rule>| inner(step.clone(), Rule::integer).map(|number| number.as_str().to_owned());
            let read = read.and_then(|step| Some((number(&step)?, action(step, 8))));
            let plain = numbered_step(line).map(|(number, action)| (number.to_owned(), action));
            assert_eq!(plain, read, "{text:?}");
        }
    }

    #[test]
    fn stops_at_the_statistics_whose_lines_have_colons_too() {
        let text = "ff: found legal plan as follows\n\nstep    0: MOVE A B\n        1: DROP\n     \n\
                    time spent:    0.00 seconds\n  7: NOT A STEP\n";
        assert_eq!(steps(text), ["MOVE A B", "DROP"]);
    }

    #[test]
    fn drops_the_pseudo_action() {
        assert_eq!(steps("ff: found legal plan as follows\nstep 0: GO A\n 1: REACH-GOAL\n"), ["GO A"]);
    }

    #[test]
    fn reads_the_verdict_on_either_stream() {
        let text = "best first search space empty! problem proven unsolvable.";
        assert_eq!(read("", text).verdict, Verdict::Unsolvable);
        assert_eq!(read(text, "").verdict, Verdict::Unsolvable);
    }

    #[test]
    fn names_the_place_of_a_syntax_error() {
        let transcript = read("", "/tmp/p.pddl: syntax error in line 3, '(':\n'define' expected");
        assert_eq!(transcript.verdict, Verdict::Rejected);
        assert_eq!(transcript.message, "/tmp/p.pddl:3: syntax error, 'define' expected at `(`");
    }

    #[test]
    fn takes_an_unknown_requirement_for_a_feature_it_lacks() {
        let transcript = read("d.pddl: syntax error in line 2, ':ACTION-COSTS':\ndomain definition expected", "");
        assert_eq!(transcript.verdict, Verdict::Unsupported);
    }

    #[test]
    fn takes_a_compiled_in_limit_for_what_it_cannot_do() {
        let text = "\ntoo many constants! increase MAX_CONSTANTS (currently 2000)\n\n";
        assert_eq!(read(text, "").verdict, Verdict::Unsupported);
        assert!(read(text, "").message.contains("increase MAX_CONSTANTS"));
    }

    #[test]
    fn reads_timed_steps_of_the_present_day_program() {
        let text =
            "\nff: found legal plan as follows\n0.000: (go a b) [5.000]\n5.001: (ring)\n\nplan makespan: 10.001\n";
        let transcript = read(text, "");
        assert_eq!(transcript.actions[0].start, Some(0.0));
        assert_eq!(transcript.actions[0].duration, Some(5.0));
        assert_eq!((transcript.actions[1].start, transcript.actions[1].duration), (Some(5.001), None));
    }

    #[test]
    fn finds_nothing_in_anything_else() {
        for text in ["", "Segmentation fault", "step 0: GO A", ":", "\0", "0: "] {
            assert_eq!(read(text, text).verdict, Verdict::Unclear, "{text:?}");
        }
    }
}
