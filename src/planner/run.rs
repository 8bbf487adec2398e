//! A planner's run on a task: its outcome, and what is known of it.

use std::time::Duration;

use super::outcome::Outcome;
use super::task::Task;
use crate::pddl::{Plan, Validation, Why, validate, why};

/// How many of a planner's last lines an error message repeats.
const TAIL: usize = 12;

/// A planner's run on a task.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// How it ended.
    pub outcome: Outcome,
    /// The planner's name.
    pub planner: String,
    /// Its version, where known.
    pub version: Option<String>,
    /// Program and arguments, with marks for the files of the run.
    pub command: Vec<String>,
    /// Wall time.
    pub time: Duration,
    /// Processor time of all its processes, to a hundredth of a second, where it is known.
    pub cpu: Option<Duration>,
    /// The most memory that its processes had resident, in bytes: of one of them, or of all at once, where there is a limit of
    /// memory and as far as it was seen.
    pub memory: Option<u64>,
    /// Why the plan could not be simulated, where that is so.
    pub unjudged: Option<String>,
    /// The planner let actions touch, and the plan has them apart ([`Plan::spaced`]).
    pub is_spaced: bool,
    /// The planner refused the costs of actions, and was sent the task without them.
    pub is_without_costs: bool,
    /// Whether rmem itself has proved that there is no plan; otherwise that is the word of another planner.
    pub is_proven: bool,
    /// The exit code of its program; none where a signal or a limit ended it.
    pub code: Option<i32>,
    /// Whether no files could be made for the run: a fault of this machine, not of the planner.
    pub is_without_files: bool,
    /// The limit that ended its program, as an outcome.
    pub limit: Option<Outcome>,
    /// Why there is no plan, where that was asked for.
    pub why: Option<Why>,
    /// The message about the outcome: the planner's own words, or what it lacks
    /// and where, or how to install it. Empty for a plan.
    pub message: String,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl Run {
    /// Simulates the plan, if there is one. A plan that does not reach the goal is none, whatever its
    /// planner says; but where only its actions touch, it is the plan with these apart.
    pub fn simulate(&mut self, task: &Task<'_>) {
        let Outcome::Plan(plan) = &mut self.outcome else { return };
        let verdict = match validate(task.domain, task.problem, &plan.steps) {
            verdict @ Validation::Invalid(_) => match spaced(plan, task) {
                Some((spaced, verdict)) => {
                    *plan = spaced;
                    self.is_spaced = true;
                    verdict
                }
                None => verdict,
            },
            verdict => verdict,
        };
        match verdict {
            Validation::Valid { value } => plan.cost = value.or(plan.cost),
            Validation::Unchecked(reason) => self.unjudged = Some(reason),
            // The planner may have been writing when its time was over.
            Validation::Invalid(_) if self.limit.is_some() => {
                self.message = format!("no whole plan within its limit; what it left: {verdict}");
                self.outcome = self.limit.clone().unwrap_or(Outcome::OutOfTime);
            }
            Validation::Invalid(_) => {
                self.message = verdict.to_string();
                self.outcome = Outcome::Invalid;
            }
        }
    }

    /// Looks into why there is no plan, where the planner found that there is none or gave up. Where it gave up and a
    /// condition of the goal can never hold, that is the proof.
    pub fn explain(&mut self, task: &Task<'_>) {
        if !matches!(self.outcome, Outcome::Unsolvable | Outcome::GaveUp) || self.why.is_some() {
            return;
        }
        let why = why(task.domain, task.problem);
        if self.outcome == Outcome::GaveUp && why.is_proof() {
            self.outcome = Outcome::Unsolvable;
            self.message = "the planner gave up, but the goal can never hold".to_owned();
        }
        self.is_proven |= why.is_proof();
        self.why = Some(why);
    }

    /// The last lines of what the planner printed, for messages.
    #[must_use]
    pub fn tail(&self) -> String {
        let printed =
            |text: &str| text.lines().filter(|line| !line.trim().is_empty()).map(str::to_owned).collect::<Vec<_>>();
        let mut lines = printed(&self.stdout);
        lines.extend(printed(&self.stderr));
        let start = lines.len().saturating_sub(TAIL);
        let tail = lines.split_off(start);
        tail.iter().map(|line| line.chars().take(200).collect::<String>()).collect::<Vec<_>>().join("\n")
    }
}

/// The plan with its actions apart, where that is valid: what planners print may leave out the gaps.
#[must_use]
pub fn spaced(plan: &Plan, task: &Task<'_>) -> Option<(Plan, Validation)> {
    let spaced = plan.spaced(&task.problem.timed().collect::<Vec<f64>>())?;
    let verdict = validate(task.domain, task.problem, &spaced.steps);
    matches!(verdict, Validation::Valid { .. }).then_some((spaced, verdict))
}
