//! The built-in planner: rmem's own [`search`] and the crate `ferroplan`, in a child process of rmem's own.
//!
//! The child is `rmem ff -o DOMAIN -f PROBLEM`, which prints what FF prints, so that
//! it serves programs written for FF as well. Being a process, it is limited, and
//! crashes, like every other planner. As the planner of `rmem plan` it gets a task that has
//! been read and written already, which [`CHECKED`] states.
//!
//! ferroplan parses every task. rmem's own search solves classical tasks, and temporal ones that need no concurrency
//! ([`temporal`]). On a task with numbers, it takes turns with a [`portfolio`] of ferroplan's searches. ferroplan alone
//! gets preferences, constraints, other temporal tasks, and what the search refuses. What ends a search is an amount of
//! work, never a clock, so that the same task has the same plan everywhere.

mod classical;
mod compared;
pub mod convert;
mod ff_output;
mod judge;
mod measure;
mod options;
mod portfolio;
mod proof;
#[cfg(test)]
mod random;
pub mod search;
mod solver;
mod temporal;
#[cfg(test)]
mod unsolvable;

use std::ffi::OsString;

use super::files::{DOMAIN, PROBLEM};
use super::interface::{Output, Planner};
use super::task::Task;
use crate::formats::plan::{Transcript, Verdict, ff};
use crate::pddl::Feature;
use crate::process::Host;

pub use options::Options;
pub use solver::{child, solve};

/// The version of ferroplan.
const VERSION: &str = "ferroplan 0.30.0";

/// What ferroplan does not read, or refuses.
const LACKS: [Feature; 7] = [
    Feature::ObjectFluents,
    Feature::ContinuousEffects,
    Feature::ActionVariables,
    Feature::DurationsAtEnd,
    Feature::TimedConditionalEffects,
    Feature::TimedPreferences,
    Feature::TimedDerivedPredicates,
];

/// What only ferroplan can handle in a temporal task.
const FERROPLAN_ONLY: [Feature; 4] =
    [Feature::DerivedPredicates, Feature::ChangingDerivedPredicates, Feature::Preferences, Feature::Constraints];

/// The requirements that ferroplan knows by name. Others announce what it may well
/// be able to do: it reads `:derived` but not the keyword for it.
const REQUIREMENTS: [&str; 21] = [
    ":strips",
    ":typing",
    ":adl",
    ":equality",
    ":negation",
    ":negative-preconditions",
    ":disjunctive-preconditions",
    ":existential-preconditions",
    ":universal-preconditions",
    ":quantified-preconditions",
    ":conditional-effects",
    ":fluents",
    ":numeric-fluents",
    ":action-costs",
    ":preferences",
    ":constraints",
    ":goal-utilities",
    ":durative-actions",
    ":duration-inequalities",
    ":timed-initial-literals",
    ":time",
];

/// The option that states that the task is known to be well-formed, in names that
/// ferroplan reads.
pub const CHECKED: &str = "--checked";

/// The option to improve the plan for as long as the child may run.
pub const ANYTIME: &str = "--anytime";

/// The built-in planner.
#[derive(Debug, Clone, Copy, Default)]
pub struct Builtin {
    /// Improve the plan until the limit of time.
    pub anytime: bool,
}

impl Planner for Builtin {
    fn name(&self) -> &str {
        "builtin"
    }

    fn version(&self) -> Option<String> {
        Some(VERSION.to_owned())
    }

    fn is_own(&self) -> bool {
        true
    }

    fn lacks(&self) -> &[Feature] {
        &LACKS
    }

    fn requirements(&self) -> Option<&[&str]> {
        Some(&REQUIREMENTS)
    }

    fn reads_only_simple_forms(&self) -> bool {
        true
    }

    fn command(&self, host: &Host<'_>) -> Vec<OsString> {
        let words = ["ff", "-o", DOMAIN, "-f", PROBLEM, CHECKED];
        let words = words.into_iter().chain(self.anytime.then_some(ANYTIME));
        std::iter::once(host.exe.clone().into()).chain(words.map(OsString::from)).collect()
    }

    /// None: ferroplan takes settings from the environment, and the same task has the same
    /// plan everywhere.
    fn environment(&self) -> Option<&[(&str, &str)]> {
        Some(&[])
    }

    fn read(&self, output: &Output) -> Transcript {
        let answer = ff::read(&ff_output::without_progress(ff_output::whole(&output.stdout)), &output.stderr);
        match output.code {
            Some(22) if answer.verdict != Verdict::Plan => Transcript {
                verdict: Verdict::OutOfMemory,
                message: output.stdout.trim().lines().last().unwrap_or_default().to_owned(),
                ..answer
            },
            // How far it was when it was ended.
            _ if answer.verdict == Verdict::Unclear && answer.message.is_empty() => {
                Transcript { message: ff_output::last_progress(&output.stdout), ..answer }
            }
            _ => answer,
        }
    }

    fn never_improves(&self, task: &Task<'_>) -> &[Feature] {
        if task.domain.is_temporal() { &FERROPLAN_ONLY } else { &[] }
    }

    /// Plans with times are improved where the search of rmem's own makes them; ferroplan makes one plan.
    fn improves(&self, task: &Task<'_>) -> bool {
        let features = || task.domain.features().iter().chain(task.problem.features()).map(|used| used.feature);
        let is_temporal = features().any(|feature| feature == Feature::DurativeActions);
        let is_for_ferroplan = features().any(|feature| FERROPLAN_ONLY.contains(&feature));
        self.anytime && !(is_temporal && is_for_ferroplan)
    }

    /// It says each plan that it finds, also where it looks for better ones for a while only.
    fn is_anytime(&self) -> bool {
        true
    }
}
