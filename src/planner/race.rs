//! Several planners at once on one task.
//!
//! The first whose plan is right wins, and the others are ended. A proof of rmem's own that there is no plan
//! ends the race as well. Where another planner says so, the others go on: a plan of one of them refutes it, and
//! without a plan it counts. A planner that cannot handle the task, is not installed or fails does not take part any
//! longer.
//!
//! The limits are one for all. Each may use what the others leave of the memory; where all of them together
//! have more than the limit, the one that has most is ended, and the others go on.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use super::attempt::PreparedPlanner;
use super::interface::Planner;
use super::outcome::Outcome;
use super::run::Run;
use super::task::Task;
use crate::formats::Source;
use crate::pddl::Plan;
use crate::process::{Host, Limits, Pool};

/// How often to look whether the race was interrupted: a user does not notice the delay.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// A race that is over.
#[derive(Debug, Clone, PartialEq)]
pub struct Race {
    /// What each planner did, in the order they were named. A planner that was stopped because another had won
    /// has [`Outcome::Interrupted`].
    pub runs: Vec<Run>,
    /// Whose outcome counts, by its place among the runs.
    pub winner: usize,
    /// Whether an interruption ended it: a plan is the best of those found until then.
    pub is_interrupted: bool,
}

impl Race {
    /// The run whose outcome counts; there is one in every race.
    #[must_use]
    pub fn winner(&self) -> Option<&Run> {
        self.runs.get(self.winner)
    }

    /// The runs that say that there is no plan, where the winner has a plan that was simulated.
    pub fn wrong_claims(&self) -> impl Iterator<Item = &Run> {
        let is_refuted = self.winner().is_some_and(refutes);
        self.runs.iter().filter(move |run| is_refuted && run.outcome == Outcome::Unsolvable)
    }

    /// The word for what a planner of the race came to.
    #[must_use]
    pub fn word(&self, run: &Run) -> &'static str {
        let is_won = self.winner().is_some_and(|run| is_decided(&run.outcome));
        match run.outcome {
            Outcome::Interrupted if is_won => "stopped",
            Outcome::Unsolvable if self.winner().is_some_and(refutes) => "wrong",
            ref outcome => outcome.word(),
        }
    }
}

/// Planners at the start: their programs are there and wait for their task.
pub struct Portfolio<'a> {
    planners: Vec<PreparedPlanner<'a>>,
    limits: Limits,
}

impl<'a> Portfolio<'a> {
    /// Starts the planners' programs, which wait for their task; meanwhile the problem may still be generated.
    #[must_use]
    pub fn new(planners: &'a [Box<dyn Planner>], limits: &Limits, host: &Host<'_>) -> Self {
        let planners = planners.iter().map(|planner| PreparedPlanner::new(planner.as_ref(), limits, host));
        Self { planners: planners.collect(), limits: *limits }
    }

    /// Lets a single planner of rmem's own begin with a large problem that is still to be checked.
    pub fn begin(&mut self, domain: &Source, problem: &Source, host: &Host<'_>) {
        if let [planner] = self.planners.as_mut_slice() {
            planner.begin(domain, problem, host);
        }
    }

    /// Lets the planners run against each other; each plan is simulated as soon as it is there. Without
    /// planners there is no race. `meanwhile` is done once they run; it should be short, as nothing looks at
    /// them then.
    #[must_use]
    pub fn race(self, task: &Task<'_>, host: &Host<'_>, meanwhile: impl FnOnce()) -> Option<Race> {
        self.run(task, host, false, meanwhile)
    }

    /// As [`Portfolio::race`], but each planner may use all of the time, and the best plan wins. Only a proof that
    /// there is no plan ends it earlier.
    #[must_use]
    pub fn race_for_the_best(self, task: &Task<'_>, host: &Host<'_>, meanwhile: impl FnOnce()) -> Option<Race> {
        self.run(task, host, true, meanwhile)
    }

    fn run(self, task: &Task<'_>, host: &Host<'_>, is_for_best: bool, meanwhile: impl FnOnce()) -> Option<Race> {
        let Self { planners, limits } = self;
        let pool = limits.memory.filter(|_| planners.len() > 1).map(|bytes| Pool::new(bytes, planners.len()));
        let mut is_interrupted = host.is_interrupted();
        let stopped = AtomicBool::new(is_interrupted);
        let (sender, ended) = mpsc::channel();
        let mut runs: Vec<Option<Run>> = planners.iter().map(|_| None).collect();
        let mut first = None;
        thread::scope(|scope| {
            for (place, planner) in planners.into_iter().enumerate() {
                let sender = sender.clone();
                let host = Host { interrupted: &stopped, ..host.clone() };
                let share = pool.as_ref().map(|pool| pool.share(place));
                scope.spawn(move || {
                    // The supervisor ends while the plan is simulated.
                    let (mut run, _ending) = planner.attempt(task, &host, share, is_for_best);
                    run.simulate(task);
                    if run.outcome == Outcome::Unsolvable && !run.is_proven {
                        // Where rmem's own proof agrees, the other planners are stopped.
                        run.explain(task);
                    }
                    let _ = sender.send((place, run));
                });
            }
            drop(sender);
            meanwhile();
            loop {
                match ended.recv_timeout(POLL_INTERVAL) {
                    Ok((place, run)) => {
                        let is_over = match run.outcome {
                            Outcome::Plan(_) => !is_for_best,
                            Outcome::Unsolvable => run.is_proven && !runs.iter().flatten().any(refutes),
                            _ => false,
                        };
                        if first.is_none() && is_over {
                            first = Some(place);
                            stopped.store(true, Ordering::SeqCst);
                        }
                        if let Some(slot) = runs.get_mut(place) {
                            *slot = Some(run);
                        }
                    }
                    Err(RecvTimeoutError::Timeout) if host.is_interrupted() => {
                        is_interrupted |= first.is_none();
                        stopped.store(true, Ordering::SeqCst);
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
            }
        });
        // A thread without a result has panicked, which the scope has passed on.
        let runs: Vec<Run> = runs.into_iter().flatten().collect();
        // Whoever says that there is no plan is wrong where another one has a plan that holds.
        let is_refuted = |place: &usize| {
            runs.get(*place).is_none_or(|run| run.outcome == Outcome::Unsolvable) && runs.iter().any(refutes)
        };
        let winner = first
            .filter(|place| *place < runs.len() && !is_refuted(place))
            .or_else(|| best(&runs, task))
            .or_else(|| most_informative(&runs))?;
        Some(Race { runs, winner, is_interrupted })
    }
}

/// Whether no planner has to go on.
fn is_decided(outcome: &Outcome) -> bool {
    matches!(outcome, Outcome::Plan(_) | Outcome::Unsolvable)
}

/// Whether a run has a plan that was simulated, so that there is a plan whatever another planner says.
fn refutes(run: &Run) -> bool {
    run.outcome.plan().is_some() && run.unjudged.is_none()
}

/// The run with the best plan; of equals the one with fewer steps, then the first named.
fn best(runs: &[Run], task: &Task<'_>) -> Option<usize> {
    let plans = runs.iter().enumerate().filter_map(|(place, run)| Some((place, run.outcome.plan()?)));
    let order = |(_, one): &(usize, &Plan), (_, other): &(usize, &Plan)| {
        badness(one, task).total_cmp(&badness(other, task)).then(one.steps.len().cmp(&other.steps.len()))
    };
    plans.min_by(order).map(|(place, _)| place)
}

/// How bad a plan is: its metric, or, where the task has none, when it ends or how many steps it has.
fn badness(plan: &Plan, task: &Task<'_>) -> f64 {
    let cost = plan.cost.unwrap_or(f64::INFINITY);
    match &task.problem.tree().metric {
        Some(metric) if metric.minimize => cost,
        Some(_) => plan.cost.map_or(f64::INFINITY, |value| -value),
        None => plan.makespan().unwrap_or(cost),
    }
}

/// The planner whose outcome is most informative where none won: a limit that can be raised before a planner that gave up by
/// itself, and what a planner did before what kept it from doing anything. Of equals, the first named.
fn most_informative(runs: &[Run]) -> Option<usize> {
    let rank = |outcome: &Outcome| match outcome {
        Outcome::Plan(_) | Outcome::Unsolvable => 0,
        Outcome::Interrupted => 1,
        Outcome::OutOfTime => 2,
        Outcome::OutOfMemory => 3,
        Outcome::GaveUp => 4,
        Outcome::Invalid | Outcome::Failed | Outcome::NoPlan | Outcome::NotExecutable => 5,
        Outcome::Unsupported => 6,
        Outcome::NotFound => 7,
    };
    runs.iter().enumerate().min_by_key(|(_, run)| rank(&run.outcome)).map(|(place, _)| place)
}

/// A table: planner, outcome, time, processor time, steps, and the cost or, of plans with times, the makespan.
impl fmt::Display for Race {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.runs.iter().map(|run| run.planner.chars().count()).max().unwrap_or_default().max(7);
        let is_temporal = self.runs.iter().filter_map(|run| run.outcome.plan()).any(|plan| plan.makespan().is_some());
        let quality = if is_temporal { "makespan" } else { "cost" };
        write!(
            f,
            "{:<width$}  {:<14}  {:>9}  {:>9}  {:>6}  {quality:>9}",
            "planner", "outcome", "time", "cpu", "steps"
        )?;
        for (place, run) in self.runs.iter().enumerate() {
            let outcome = self.word(run);
            let seconds = |time: Duration| format!("{:.2} s", time.as_secs_f64());
            let steps = run.outcome.plan().map_or_else(|| "-".to_owned(), |plan| plan.steps.len().to_string());
            let (time, cpu) = (seconds(run.time), run.cpu.map_or_else(|| "-".to_owned(), seconds));
            let quality = run.outcome.plan().and_then(|plan| if is_temporal { plan.makespan() } else { plan.cost });
            let quality = quality.map_or_else(|| "-".to_owned(), |quality| ((quality * 1e3).round() / 1e3).to_string());
            let mark = match run.outcome {
                _ if place != self.winner => "",
                Outcome::Plan(_) => "  wins",
                Outcome::Unsolvable => "  decides",
                _ => "",
            };
            write!(f, "\n{:<width$}  {outcome:<14}  {time:>9}  {cpu:>9}  {steps:>6}  {quality:>9}{mark}", run.planner)?;
        }
        Ok(())
    }
}
