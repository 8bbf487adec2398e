//! A plan, in a file of its own or among what a planner printed.

use super::file::{PlanFile, Spelling, plan_file};
use super::printed::dialect;
use super::transcript::{Counted, Transcript, Verdict};
use super::{behind, ff};
use crate::formats::{Diagnostic, Source, Span};

/// Reads a plan file; the first line that is not empty and not a comment shows how it
/// is spelled. An empty file is the empty plan. The plan may have all the rest of a planner's
/// output around it: of several plans in that, the last is taken. In any other file all steps are one plan.
///
/// # Errors
///
/// What is not a step, at its place; output of a planner in which there is no plan.
pub fn read_plan(source: &Source) -> Result<PlanFile, Diagnostic> {
    read(source, if dialect(source.text()).is_some() { Counted::Last } else { Counted::All })
}

/// Reads what a planner left or printed, of which the last plan is taken.
///
/// # Errors
///
/// As [`read_plan`].
pub(super) fn read_last_plan(source: &Source) -> Result<PlanFile, Diagnostic> {
    read(source, Counted::Last)
}

fn read(source: &Source, counted: Counted) -> Result<PlanFile, Diagnostic> {
    let plan = match plan_file(source, counted) {
        // FF's plan with a line missing.
        Err(error) if source.text().lines().any(ff::is_found) => Err(error),
        Err(error) => printed(source).unwrap_or(Err(error)),
        plan => plan,
    }?;
    if plan.is_printed { behind::last(source, plan) } else { Ok(plan) }
}

/// The plan in the output of a planner, where the text is that.
fn printed(source: &Source) -> Option<Result<PlanFile, Diagnostic>> {
    let Transcript { verdict, actions, cost, message, .. } = super::printed::printed(source.text())?;
    if verdict != Verdict::Plan {
        let end = Span::at(source.text().trim_end().len());
        let message = if message.is_empty() { String::new() } else { format!(": {message}") };
        return Some(Err(Diagnostic::new(source, end, format!("the planner's output has no plan{message}"))));
    }
    let spelling = match actions.iter().any(|action| action.start.is_some()) {
        true => Spelling::Temporal,
        false => Spelling::Ipc,
    };
    Some(Ok(PlanFile { spelling, actions, cost, is_printed: true }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> PlanFile {
        read_plan(&Source::new("plan", text)).unwrap()
    }

    #[test]
    fn tells_the_three_spellings_apart() {
        for (text, spelling) in [
            ("(move r2 k l)\n", Spelling::Ipc),
            ("; found in 2 s\n(move r2 k l)\n; cost = 1 (unit cost)\n", Spelling::Ipc),
            ("step    0: MOVE R2 K L\n        1: DROP\n", Spelling::Ff),
            ("0: MOVE R2 K L\n", Spelling::Ff),
            ("0.000: (move r2 k l) [1]\n", Spelling::Temporal),
            ("0: (move r2 k l)\n", Spelling::Temporal),
            ("\u{feff}(move r2 k l)\n", Spelling::Ipc),
            ("\u{feff}0: MOVE R2 K L\n", Spelling::Ff),
            ("\u{feff}0: (move r2 k l)\n", Spelling::Temporal),
        ] {
            let plan = read(text);
            assert_eq!(plan.spelling, spelling, "{text}");
            assert_eq!(
                plan.actions[0].arguments,
                match spelling {
                    Spelling::Ff => ["R2", "K", "L"],
                    _ => ["r2", "k", "l"],
                }
            );
        }
    }

    #[test]
    fn an_empty_file_is_the_empty_plan() {
        for text in ["", "\n\n", "; cost = 0 (unit cost)\n"] {
            assert_eq!(read(text).actions, [], "{text:?}");
        }
    }

    #[test]
    fn all_steps_of_a_plan_file_count() {
        let names = |text: &str| read(text).actions.into_iter().map(|action| action.name).collect::<String>();
        for (text, all) in [
            ("; robot 1\n0: (b) [2]\n2.1: (b) [2]\n; robot 2\n0: (c) [1]\n", "bbc"),
            ("0: (a) [2]\n2.1: (b) [2]\n\n0: (c) [1]\n", "abc"),
            ("0: (a) [1]\n1: (b) [1]\n0: (a) [1]\n", "aba"),
            ("; time of robot 1\n0: (a) [1]\n; time of robot 2\n0: (b) [1]\n", "ab"),
            ("(a)\n; cost = 1 (unit cost)\n(b)\n", "ab"),
            // The output of a planner has several plans.
            ("; Plan found with metric 9\n0: (a) [2]\n\n; Plan found with metric 3\n0: (b) [1]\n", "b"),
        ] {
            assert_eq!(names(text), all, "{text}");
        }
        assert_eq!(read("(a)\n; cost = 1 (unit cost)\n(b)\n").cost, None);
    }

    #[test]
    fn steps_may_share_a_line() {
        assert_eq!(read("(a) (b x)\n(c)").actions.len(), 3);
    }

    #[test]
    fn what_is_not_a_plan_is_an_error_at_its_place() {
        for (text, place) in [
            ("hello", (1, 1)),
            ("(a)\nhello", (2, 1)),
            ("(a) b", (1, 5)),
            ("()", (1, 2)),
            ("(a (b))", (1, 4)),
            ("0: GO A\n  what", (2, 3)),
            ("0: (a)\n1e400: (go a b) [5]", (2, 1)),
            ("0: (a) [1e999]", (1, 9)),
        ] {
            let error = read_plan(&Source::new("plan", text)).unwrap_err();
            assert_eq!(error.position(), place, "{error}");
        }
    }

    #[test]
    fn nesting_and_size_end_in_an_error() {
        let deep = "(".repeat(100_000);
        assert!(read_plan(&Source::new("plan", deep)).is_err());
        let long = format!("(a {})", "x ".repeat(200_000));
        assert_eq!(read(&long).actions[0].arguments.len(), 200_000);
    }
}
