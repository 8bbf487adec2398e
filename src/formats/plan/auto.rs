//! The run of a planner, whichever it is.

use super::printed::{Dialect, dialect};
use super::read::read_last_plan;
use super::transcript::{Transcript, Verdict};
use super::{behind, downward, ff, temporal};
use crate::formats::Source;

/// Reads a run of any planner: the plan files that it left, the last of them the best, its exit code, and what it printed.
#[must_use]
pub fn read(plans: &[Source], code: Option<i32>, stdout: &str, stderr: &str) -> Transcript {
    let transcript = match dialect(stdout).or_else(|| dialect(stderr)) {
        Some(Dialect::Ff) => ff::read(stdout, stderr),
        Some(Dialect::Downward) => downward::read(plans, code, stdout, stderr),
        Some(Dialect::Temporal) => unproven(temporal::read(plans, stdout, stderr)),
        None => {
            let ff = ff::read(stdout, stderr);
            if ff.verdict == Verdict::Unclear { unproven(temporal::read(plans, stdout, stderr)) } else { ff }
        }
    };
    if transcript.verdict == Verdict::Plan {
        return if plans.is_empty() { behind::last_of_run(stdout, transcript) } else { transcript };
    }
    filed(plans).or_else(|| file(&Source::new("<stdout>", stdout))).unwrap_or(transcript)
}

/// The last plan file that a planner left, whatever its spelling and whether or not it has a last line with the cost.
#[must_use]
pub fn filed(plans: &[Source]) -> Option<Transcript> {
    plans.iter().rev().find_map(file)
}

fn file(source: &Source) -> Option<Transcript> {
    let plan = read_last_plan(source).ok().filter(|plan| !plan.actions.is_empty() || plan.cost.is_some())?;
    let mut transcript = Transcript::unclear();
    (transcript.verdict, transcript.actions, transcript.cost) = (Verdict::Plan, plan.actions, plan.cost);
    Some(transcript)
}

/// Temporal planners look at some moments of many: what they say of all plans is no proof.
fn unproven(transcript: Transcript) -> Transcript {
    match transcript.verdict {
        Verdict::Unsolvable => {
            let message = format!("{} (its search proves nothing)", transcript.message);
            Transcript { verdict: Verdict::GaveUp, message, ..transcript }
        }
        _ => transcript,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POPF: &str = "Number of literals: 4\nConstructing lookup tables: [10%] [20%]\nInitial heuristic = 3.000\n\
b (2.000 | 0.000)b (1.000 | 5.001);;;; Solution Found\n; States evaluated: 9\n; Cost: 10.002\n; Time 0.01\n\
0.000: (go a b)  [5.000]\n5.001: (go b c)  [5.000]\n\n; Plan found with metric 8.000\n; States evaluated so far: 12\n\
0.000: (fly a c)  [8.000]\n";

    #[test]
    fn the_last_plan_of_popf_is_taken() {
        let plan = crate::formats::plan::read_plan(&Source::new("out", POPF)).unwrap();
        assert_eq!(plan.actions.iter().map(|action| action.name.as_str()).collect::<Vec<_>>(), ["fly"]);
        let run = read(&[], Some(0), POPF, "");
        assert_eq!((run.verdict, run.actions.len()), (Verdict::Plan, 1));
    }

    #[test]
    fn a_plan_file_of_any_spelling_counts_and_so_do_steps_alone() {
        for text in ["(a)\n(b)\n", "0: (a)\n1: (b)\n", "0: A\n1: B\n"] {
            assert_eq!(read(&[Source::new("plan", text)], Some(0), "done", "").actions.len(), 2, "{text}");
            assert_eq!(read(&[], Some(0), text, "").actions.len(), 2, "{text}");
        }
        assert_eq!(read(&[], Some(0), "hello", "").verdict, Verdict::Unclear);
        assert_eq!(read(&[], Some(0), "; Problem unsolvable!\nNumber of literals: 2\n", "").verdict, Verdict::GaveUp);
    }
}
