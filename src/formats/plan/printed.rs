//! Which planner printed a text, and the plan in it.
//!
//! Sentences that one of them prints and no plan file has say which reader understands the rest. Sources: recorded runs
//! (fixtures/transcripts), and for POPF and OPTIC the format of their output: `b (9.000 | 110.001)` for each better state,
//! `;;;; Solution Found`, comments with the cost and the time, then the steps.

use super::transcript::Transcript;
use super::{downward, ff, temporal};

/// How the sentences of temporal planners begin, in lower case.
const TEMPORAL: [&str; 10] = [
    "plan computed:",
    "solution number:",
    "numeric_threats_mode",
    "number of literals",
    "constructing lookup tables",
    "initial heuristic =",
    "; plan found with metric",
    ";;;; solution found",
    "b (",
    "; version lpg",
];

/// How those of Fast Downward begin.
const DOWNWARD: [&str; 5] = ["info ", "[t=", "solution found!", "translate exit code", "plan length:"];

/// How those of FF and Metric-FF begin.
const FF: [&str; 4] =
    ["ff:", "advancing to distance:", "cueing down from goal distance:", "best first search space empty"];

/// The reader of a text, where a sentence in it says which.
pub(super) fn dialect(text: &str) -> Option<Dialect> {
    let has = |beginnings: &[&str]| {
        text.lines()
            .map(|line| line.trim_start().get(..32.min(line.trim_start().len())).unwrap_or_default().to_lowercase())
            // `b (1)` is a step of an action `b`.
            .filter(|line| !line.starts_with("b (") || line.contains('|'))
            .any(|line| beginnings.iter().any(|beginning| line.starts_with(beginning)))
    };
    if has(&TEMPORAL) {
        return Some(Dialect::Temporal);
    }
    if has(&DOWNWARD) {
        return Some(Dialect::Downward);
    }
    has(&FF).then_some(Dialect::Ff)
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Dialect {
    Ff,
    Downward,
    Temporal,
}

/// Reads all that a planner printed; nothing where no sentence in it is one of a planner's.
pub(super) fn printed(text: &str) -> Option<Transcript> {
    Some(match dialect(text)? {
        Dialect::Ff => ff::read(text, ""),
        Dialect::Temporal => temporal::read(&[], text, ""),
        Dialect::Downward => downward::printed(text),
    })
}
