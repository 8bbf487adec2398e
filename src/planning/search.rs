//! Running the planners on a task.

use std::panic::resume_unwind;
use std::thread;
use std::time::Instant;

use super::{PlanRequest, PlanResult, PlanningError, PlanningTask};
use crate::formats::Diagnostic;
use crate::interrupt::InterruptGuard;
use crate::memory::Memory;
use crate::planner::{Host, Limits, Planner, Portfolio, Task, not_improved};
use crate::store::StoreError;

/// A task, and the planners' programs, which have started and wait for it.
pub struct PreparedSearch<'a> {
    request: &'a PlanRequest,
    portfolio: Portfolio<'a>,
    task: PlanningTask,
}

/// Instantiates the task while the planners' programs start.
///
/// # Errors
/// Where the problem cannot be had, or is wrong.
pub fn prepare<'a>(
    request: &'a PlanRequest,
    memory: &Memory,
    host: &Host<'_>,
) -> Result<PreparedSearch<'a>, PlanningError> {
    let (task, portfolio) = thread::scope(|scope| {
        let starting = scope.spawn(|| start(&request.planners, &request.options.limits(), host));
        (instantiate(request, memory), starting.join().unwrap_or_else(|panic| resume_unwind(panic)))
    });
    Ok(PreparedSearch { request, portfolio, task: task? })
}

/// As [`prepare`], where the planners' programs were started before the request was made.
///
/// # Errors
/// Where the problem cannot be had, or is wrong.
pub fn prepare_started<'a>(
    request: &'a PlanRequest,
    memory: &Memory,
    starting: impl FnOnce() -> Portfolio<'a>,
) -> Result<PreparedSearch<'a>, PlanningError> {
    let task = instantiate(request, memory);
    Ok(PreparedSearch { request, portfolio: starting(), task: task? })
}

/// Starts the planners' programs, which then wait for their task. Those that are not wanted end where this is dropped.
pub fn start<'a>(planners: &'a [Box<dyn Planner>], limits: &Limits, host: &Host<'_>) -> Portfolio<'a> {
    // An interruption has to wait until the supervisors can clean up.
    let guard = InterruptGuard::new();
    let portfolio = Portfolio::new(planners, limits, host);
    guard.end();
    portfolio
}

fn instantiate(request: &PlanRequest, memory: &Memory) -> Result<PlanningTask, PlanningError> {
    PlanningTask::instantiate(&request.source, request.generated.clone(), &request.domain, memory)
}

impl<'a> PreparedSearch<'a> {
    /// The task.
    #[must_use]
    pub fn task(&self) -> &PlanningTask {
        &self.task
    }

    /// Whether one of the planners looks for better plans of this task once it has found one.
    #[must_use]
    pub fn improves(&self) -> bool {
        let task = Task { domain: &self.request.domain, problem: &self.task.problem };
        self.request.planners.iter().any(|planner| planner.improves(&task))
    }

    /// What of the task keeps the planners from that, at its place, where it is that.
    #[must_use]
    pub fn not_improved(&self) -> Option<Diagnostic> {
        let task = Task { domain: &self.request.domain, problem: &self.task.problem };
        not_improved(&self.request.planners, &task)
    }

    /// Runs the planners until one of them has won, or the limits end them. A plan that was found is simulated; where
    /// there is none, the reason is looked for.
    ///
    /// # Errors
    /// Where the request names no planner.
    pub fn search(self, memory: &Memory, host: &Host<'_>) -> Result<PlanResult<'a>, PlanningError> {
        let Self { request, portfolio, task } = self;
        let pddl = Task { domain: &request.domain, problem: &task.problem };
        let start = Instant::now();
        let mut lineage = None;
        let meanwhile = || {
            task.problem.prepare();
            // The texts may be long, and are hashed.
            lineage = Some(task.lineage(request.source.clone()));
            if let Some(into) = &request.options.into {
                memory.prepare(into);
            }
        };
        let race = match request.options.anytime {
            true => portfolio.race_for_the_best(&pddl, host, meanwhile),
            false => portfolio.race(&pddl, host, meanwhile),
        };
        let race = race.ok_or(PlanningError::NoPlanner)?;
        let time = start.elapsed();
        let mut run = race.winner().ok_or(PlanningError::NoPlanner)?.clone();
        if run.is_without_files {
            let (address, reason) = (host.temporary.display().to_string(), run.message);
            return Err(StoreError::Failed { address, reason }.into());
        }
        run.explain(&pddl);
        let lineage = lineage.unwrap_or_else(|| task.lineage(request.source.clone()));
        Ok(PlanResult::new(request, task, lineage, race, run, time))
    }
}
