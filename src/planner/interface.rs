//! What rmem has to know of a planner: how its program is called, how its output is read, and what it can do.

use std::ffi::OsString;

use super::sizes::Sizes;
use super::task::Task;
use crate::formats::Source;
use crate::formats::plan::Transcript;
use crate::pddl::Feature;
use crate::process::Host;

/// A program that plans.
pub trait Planner: Send + Sync {
    /// What the user calls it.
    fn name(&self) -> &str;

    /// Its version, where that is known without running it.
    fn version(&self) -> Option<String> {
        None
    }

    /// Whether it is rmem itself, whose word that there is no plan is a proof.
    fn is_own(&self) -> bool {
        false
    }

    /// What it cannot do, what is most worth saying first.
    fn lacks(&self) -> &[Feature] {
        &[]
    }

    /// How large a task may be for it, where its tables have fixed sizes.
    fn sizes(&self) -> Option<Sizes> {
        None
    }

    /// The requirement keywords it knows; none where it takes any.
    fn requirements(&self) -> Option<&[&str]> {
        None
    }

    /// Whether it reads neither things of several types nor durative actions that are more than lists of moments.
    fn reads_only_simple_forms(&self) -> bool {
        false
    }

    /// Program and arguments. `{domain}`, `{problem}` and `{plan}` stand for files; the plan's
    /// is not there until the planner writes it.
    fn command(&self, host: &Host<'_>) -> Vec<OsString>;

    /// Another command to try after such an answer to the first.
    fn again(&self, _answer: &Transcript, _command: &[OsString]) -> Option<Vec<OsString>> {
        None
    }

    /// The program's whole environment, where it does not get rmem's.
    fn environment(&self) -> Option<&[(&str, &str)]> {
        None
    }

    /// What it has printed.
    fn read(&self, output: &Output) -> Transcript;

    /// With what in a task its word that there is no plan is not a proof.
    fn doubts(&self) -> &[Feature] {
        &[]
    }

    /// Whether it can prove that there is no plan at all.
    fn proves(&self) -> bool {
        true
    }

    /// Whether a plan it left when its time ran out counts: it writes whole plans, each
    /// better than the one before.
    fn is_anytime(&self) -> bool {
        false
    }

    /// Whether it looks for better plans of this task once it has found one.
    fn improves(&self, _task: &Task<'_>) -> bool {
        self.is_anytime()
    }

    /// What of a task keeps it from that.
    fn never_improves(&self, _task: &Task<'_>) -> &[Feature] {
        &[]
    }

    /// How to get the program.
    fn install(&self) -> String {
        format!("install `{}`, or name another planner with --planner", self.name())
    }
}

/// What a planner's program left.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// The exit code; none where a signal or a limit ended it.
    pub code: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
    /// Plan files, the last of them the best.
    pub plans: Vec<Source>,
}
