//! The built-in planner's answers in FF's words.

use std::fmt::Write as _;

use ferroplan::{Plan, SolveError, Step};

use crate::formats::pddl::portable::Sent;
use crate::formats::plan::Action;

/// What the text of a whole plan ends with. A plan without it was cut off.
pub(super) const END: &str = "\ntime spent:    not measured\n\n";

/// What there is of a text before a plan in it was cut off.
pub(super) fn whole(text: &str) -> &str {
    match text.rfind(END) {
        Some(end) => &text[..end + END.len()],
        None => text,
    }
}

/// What FF says before it plans.
pub(super) fn preface(domain: &str, problem: &str) -> String {
    format!(
        "\nff: parsing domain file\ndomain '{domain}' defined\n ... done.\nff: parsing problem file\nproblem '{problem}' defined\n ... done.\n\n\n"
    )
}

/// A plan in FF's spelling, or with times where it has times.
pub(super) fn plan(plan: &Plan, sent: Option<&Sent>) -> String {
    if plan.steps.is_empty() && plan.metric.is_none_or(|metric| metric == 0.0) {
        return format!("\nff: goal can be simplified to TRUE. The empty plan solves it\n{END}");
    }
    let mut text = "\nff: found legal plan as follows\n".to_owned();
    match plan.makespan {
        Some(makespan) => {
            text.push('\n');
            for step in &plan.steps {
                let _ = write!(text, "{:.3}: ({})", step.time.unwrap_or_default(), words(step, sent).to_lowercase());
                let _ = match step.duration {
                    Some(duration) => writeln!(text, " [{duration:.3}]"),
                    None => writeln!(text),
                };
            }
            let _ = writeln!(text, "\nplan makespan: {makespan:.3}");
        }
        None => {
            text.push_str("\nstep ");
            for (index, step) in plan.steps.iter().enumerate() {
                let _ = write!(text, "{index:4}: {}\n     ", words(step, sent).to_uppercase());
            }
            text.push('\n');
            if let Some(metric) = plan.metric {
                let _ = writeln!(text, "plan cost: {metric:.6}");
            }
        }
    }
    text.push_str(END);
    text
}

/// What a line about the progress begins with.
const PROGRESS: &str = "ff: so far: ";

/// How far the work is, in a line of its own.
pub(super) fn progress(words: &str) -> String {
    format!("{PROGRESS}{words}\n")
}

/// A text without the lines about the progress, which a reader of FF's would take for complaints.
pub(super) fn without_progress(text: &str) -> String {
    text.split_inclusive('\n').filter(|line| !line.starts_with(PROGRESS)).collect()
}

/// The last report of progress, or nothing.
pub(super) fn last_progress(text: &str) -> String {
    text.lines().rev().find_map(|line| line.strip_prefix(PROGRESS)).unwrap_or_default().to_owned()
}

/// A step in words, with the names of the task.
fn words(step: &Step, sent: Option<&Sent>) -> String {
    let Some(sent) = sent else {
        return std::iter::once(&step.action).chain(&step.args).cloned().collect::<Vec<_>>().join(" ");
    };
    let (name, arguments) = (step.action.clone(), step.args.clone());
    let step = sent.restore(&Action { name, arguments, start: None, duration: None, line: 0 });
    std::iter::once(step.name).chain(step.arguments).collect::<Vec<_>>().join(" ")
}

/// What there is to say when there is no plan, and the exit code for it.
pub(super) fn no_plan(reason: &NoPlan) -> (String, i32) {
    match reason {
        NoPlan::GoalFalse => ("\nff: goal can be simplified to FALSE. No plan will solve it\n\n".to_owned(), 11),
        NoPlan::Bounded(why) => {
            (format!("\nff: goal can be simplified to FALSE. No plan will solve it: {why}\n\n"), 11)
        }
        NoPlan::Exhausted => ("\nbest first search space empty! problem proven unsolvable.\n\n".to_owned(), 11),
        NoPlan::GaveUp(why) => (format!("\nsearch cap reached! no plan found{}.\n\n", bracketed(why)), 12),
        NoPlan::Full(why) => (format!("\nnot enough memory: {why}\n\n"), 22),
        NoPlan::Doubted { doubt } => {
            let text = format!("no plan found; for a task with {doubt}, that does not prove that there is none");
            (format!("\nsearch cap reached! {text}.\n\n"), 12)
        }
    }
}

fn bracketed(why: &str) -> String {
    if why.is_empty() { String::new() } else { format!(" ({why})") }
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum NoPlan {
    /// The goal cannot be reached, whatever the order of actions.
    GoalFalse,
    /// As before, because of the bounds of numbers.
    Bounded(String),
    /// There is no state left to look at.
    Exhausted,
    /// The planner stopped without having seen everything.
    GaveUp(String),
    /// It has no more memory, and this is what took it.
    Full(String),
    /// It has seen everything it wanted to see, which for this task is no proof.
    Doubted {
        /// What in the task makes it none.
        doubt: &'static str,
    },
}

/// What ferroplan has against a task, and the exit code for it.
pub(super) fn refusal(error: &SolveError) -> (String, i32) {
    match error {
        SolveError::DomainParse(error) => (format!("\nff: parse error in domain file: {error}\n"), 3),
        SolveError::ProblemParse(error) => (format!("\nff: parse error in problem file: {error}\n"), 3),
        SolveError::EmptyType { kind, pred, ty } => {
            (format!("\n{kind} {pred} is declared to use unknown or empty type {ty}\n"), 3)
        }
        SolveError::Derived(words) | SolveError::Unsupported(words) => (format!("\nff: {words}\n"), 34),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_no_complaint() {
        use crate::formats::plan::{Verdict, ff};

        let text = format!("{}\nff: parsing\n{}{}", progress("2 states"), progress("3 states"), progress("4 states"));
        assert_eq!(without_progress(&text), "\nff: parsing\n");
        assert_eq!(last_progress(&text), "4 states");
        assert_eq!(ff::read(&without_progress(&progress("2 states")), "").verdict, Verdict::Unclear);
    }

    #[test]
    fn a_plan_that_was_cut_off_does_not_replace_the_one_before() {
        let steps = |action: &str| {
            let step = Step { index: 0, action: action.to_owned(), args: Vec::new(), time: None, duration: None };
            Plan { length: 1, steps: vec![step], metric: None, makespan: None }
        };
        let (first, second) = (plan(&steps("FIRST"), None), plan(&steps("SECOND"), None));
        let both = format!("{first}{second}");
        assert_eq!(whole(&both), both);
        for cut in 1..second.len() {
            assert_eq!(whole(&both[..first.len() + cut]), first);
        }
        assert_eq!(whole("search cap reached!"), "search cap reached!");
    }
}
