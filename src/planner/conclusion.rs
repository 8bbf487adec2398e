//! The outcome of a planner's run, from how its program ended and what it printed.

use super::capabilities::doubt;
use super::interface::Planner;
use super::outcome::Outcome;
use super::task::Task;
use crate::formats::pddl::portable::Sent;
use crate::formats::plan::{Transcript, Verdict};
use crate::pddl::{Plan, Step};
use crate::process::{End, Ended, Limits};

/// What a run amounts to, and the message about it.
pub(super) fn conclude(
    planner: &dyn Planner,
    ended: &Ended,
    answer: Transcript,
    sent: &Sent,
    task: &Task<'_>,
    limits: &Limits,
) -> (Outcome, String) {
    // At a limit, the last of the plans that a planner has made better and better is its answer.
    let keeps = planner.is_anytime() && answer.verdict == Verdict::Plan;
    match &ended.end {
        End::Missing => return (Outcome::NotFound, planner.install()),
        End::NoInterpreter(path) => {
            return (Outcome::NotFound, format!("its program is there, but not the interpreter `{path}` of it"));
        }
        End::Interrupted if !keeps => return (Outcome::Interrupted, String::new()),
        End::TooMuchOutput => {
            return (Outcome::NoPlan, format!("its program printed more than {} MiB", limits.output >> 20));
        }
        End::OutOfTime if !keeps => {
            let time = limits.time.unwrap_or_default();
            let words = match answer.verdict {
                Verdict::Unclear if !answer.message.is_empty() => {
                    format!("no plan within {time:?} ({})", answer.message)
                }
                _ => format!("no plan within {time:?}"),
            };
            return (Outcome::OutOfTime, words);
        }
        End::Starved if !keeps => return (Outcome::OutOfMemory, starved(&answer, limits)),
        End::Failed(words) | End::SupervisorGone(words) if ended.out_of_memory => {
            return (Outcome::OutOfMemory, words.clone());
        }
        End::SupervisorGone(words) => return (Outcome::Failed, words.clone()),
        End::Failed(words) | End::NoFiles(words) => {
            return (Outcome::NotExecutable, format!("its program could not be run: {words}"));
        }
        _ => {}
    }
    if ended.is_disk_full && !matches!(answer.verdict, Verdict::Unsolvable | Verdict::Plan) && !ended.out_of_memory {
        let words = "the disk is full, so its program could not write its files; free space there, or set TMPDIR";
        return (Outcome::NotExecutable, words.to_owned());
    }
    let crash = crash(&ended.end);
    match answer.verdict {
        Verdict::Plan if crash.is_none() || (keeps && ended.out_of_memory) => {
            (Outcome::Plan(restored(answer, sent).timed_as(task.domain, task.problem)), String::new())
        }
        Verdict::Unsolvable if crash.is_none() && !planner.proves() => {
            (Outcome::GaveUp, format!("{} (its search proves nothing)", answer.message))
        }
        Verdict::Unsolvable if crash.is_none() => match doubt(planner, task) {
            None => (Outcome::Unsolvable, answer.message),
            Some(doubt) => (Outcome::GaveUp, format!("{} (no proof for a task with {doubt})", answer.message)),
        },
        Verdict::GaveUp if crash.is_none() => (Outcome::GaveUp, answer.message),
        Verdict::Unsupported => (Outcome::Unsupported, answer.message),
        Verdict::OutOfMemory => (Outcome::OutOfMemory, with_limit(&answer.message, limits)),
        Verdict::OutOfTime => (Outcome::OutOfTime, answer.message),
        _ if ended.out_of_memory => (Outcome::OutOfMemory, starved(&answer, limits)),
        Verdict::Unclear if ended.end == End::Exited(127) => absent(&ended.stderr),
        Verdict::Rejected => (Outcome::NoPlan, format!("it refused its input: {}", answer.message)),
        Verdict::NoCriterion => (Outcome::NoPlan, answer.message),
        _ => match (crash, &ended.end) {
            (Some(crash), _) => (Outcome::Failed, crash),
            (None, End::Exited(code)) if *code != 0 => (Outcome::Failed, exited(*code, &answer.message, &ended.stderr)),
            (None, _) if answer.message.is_empty() => (Outcome::NoPlan, "what it returned is not a plan".to_owned()),
            (None, _) => (Outcome::NoPlan, answer.message),
        },
    }
}

/// A planner's words about its memory without the system's number of the error, and the limit that was too low.
fn with_limit(words: &str, limits: &Limits) -> String {
    let words = words.split(" (os error").next().unwrap_or_default();
    match limits.memory {
        Some(bytes) if bytes < i64::MAX as u64 => format!("{words}; {}", memory(limits)),
        _ => words.to_owned(),
    }
}

/// The limit of memory that was too low, and how far the planner was.
fn starved(answer: &Transcript, limits: &Limits) -> String {
    match answer.verdict {
        Verdict::Unclear if !answer.message.is_empty() => format!("{} ({})", memory(limits), answer.message),
        _ => memory(limits),
    }
}

fn memory(limits: &Limits) -> String {
    let bytes = limits.memory.unwrap_or_default();
    match bytes {
        0..1024 => format!("its limit was {bytes} bytes"),
        1024..0x10_0000 => format!("its limit was {} KiB", bytes >> 10),
        _ => format!("its limit was {} MiB", bytes >> 20),
    }
}

/// The outcome of a program that is there and exits with 127. That is what shells do when
/// they cannot find what they are to run, which they say.
fn absent(stderr: &str) -> (Outcome, String) {
    let words = last_line(stderr);
    let lower = words.to_lowercase();
    match ["not found", "no such file"].iter().any(|complaint| lower.contains(complaint)) {
        true => (Outcome::NotFound, format!("its program calls another: {words}")),
        false if words.is_empty() => (Outcome::Failed, "it exited with 127".to_owned()),
        false => (Outcome::Failed, format!("it exited with 127: {words}")),
    }
}

/// The message about a program that ended with an exit code other than 0 and without a plan: the reader's, or the last
/// line that it wrote to stderr.
fn exited(code: i32, message: &str, stderr: &str) -> String {
    let words = if message.is_empty() { last_line(stderr) } else { message };
    let words: String = words.chars().take(200).collect();
    if words.is_empty() { format!("it exited with {code}") } else { format!("it exited with {code}: {words}") }
}

/// The last line with words.
fn last_line(text: &str) -> &str {
    text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or_default().trim()
}

/// A crash: a signal, also as a shell reports one.
fn crash(end: &End) -> Option<String> {
    match end {
        End::Signalled(signal) => Some(format!("its program was ended by signal {signal}")),
        End::Exited(code @ 129..=165) => Some(format!("its program was ended by signal {}", code - 128)),
        _ => None,
    }
}

fn restored(answer: Transcript, sent: &Sent) -> Plan {
    let mut steps: Vec<_> = answer.actions.iter().map(|action| Step::from(sent.restore(action))).collect();
    steps.sort_by(|a, b| a.start.unwrap_or_default().total_cmp(&b.start.unwrap_or_default()));
    Plan { steps, cost: answer.cost }
}
