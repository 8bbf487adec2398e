//! `rmem plan --watch`: plans again when the memory has changed and the plan does not hold any more.

use std::sync::atomic::Ordering;

use super::find::{Found, find};
use super::source::SectionCounts;
use crate::commands::{Context, UsageError, error};
use crate::error::Result;
use crate::exit::Exit;
use crate::fault::{AtFault as _, Fault};
use crate::interrupt::InterruptGuard;
use crate::memory::Memory;
use crate::planning::{Monitor, PlanRequest, PlanState, PlanningError};
use crate::store::Namespace;

pub(super) fn run(
    mut request: PlanRequest,
    sections: SectionCounts,
    memory: &Memory,
    context: &mut Context<'_>,
) -> Result<Exit> {
    let plans = request.options.into.clone().ok_or_else(|| UsageError::new("--watch needs a plan that is stored"))?;
    let found = find(&request, sections, memory, context)?;
    let mut monitor = Monitor::new(&plans, memory)?;
    monitor.add(&found.namespaces)?;
    let names: Vec<String> = found.namespaces.iter().map(Namespace::to_string).collect();
    let mut current = match plan_of(found) {
        Ok(current) => current,
        Err(exit) => return Ok(exit),
    };
    context.output.flush()?;
    context.output.note(&format!("watching {}", names.join(", ")));
    // Why there is no plan, as far as it is said.
    let mut said = String::new();
    loop {
        // The first check covers what changed while the plan was made, each later one what changed since.
        if let State::Over(why) = state(current.as_deref(), &plans, memory, context)? {
            said.push_str(&why);
            request.rerun_of = current.take().or(request.rerun_of);
            match find(&request, SectionCounts::Silent, memory, context) {
                Ok(found) => {
                    let more = monitor.add(&found.namespaces)?;
                    said.clear();
                    match plan_of(found) {
                        Ok(found) => current = found,
                        Err(exit) => return Ok(exit),
                    }
                    if more {
                        // Changes of the new collections before they were watched were not received.
                        continue;
                    }
                }
                // The memory may have no well-formed problem at the moment.
                Err(error) if error.fault() == Fault::Input => {
                    let text = error::text(&error);
                    if said.contains(&text) && !why.is_empty() {
                        context.output.warn("no plan: for the same reason");
                    } else if !said.contains(&text) {
                        context.output.warn(&format!("no plan: {text}"));
                        said = text;
                    }
                }
                Err(error) => return Err(error),
            }
            context.output.flush()?;
        }
        if let Some(exit) = wait(&mut monitor, context)? {
            return Ok(exit);
        }
    }
}

/// The plan that was found, or none for now. An outcome that no change of the memory would alter ends the watch.
fn plan_of(found: Found) -> Result<Option<String>, Exit> {
    match found.exit {
        Exit::Done => Ok(found.id),
        Exit::Unsolvable | Exit::GaveUp | Exit::OutOfTime | Exit::OutOfMemory => Ok(None),
        exit => Err(exit),
    }
}

/// Whether the plan still reaches its goal.
enum State {
    Holds,
    /// It does not, or there is none; with what was said of it.
    Over(String),
}

/// Whether the plan still reaches its goal; otherwise reports why not.
fn state(current: Option<&str>, plans: &Namespace, memory: &Memory, context: &mut Context<'_>) -> Result<State> {
    let Some(id) = current else { return Ok(State::Over(String::new())) };
    let lines = match PlanState::of(id, plans, memory) {
        Ok(PlanState::Holds) => return Ok(State::Holds),
        Ok(PlanState::Broken(check)) => check.lines(),
        Ok(PlanState::Gone(error)) => vec![error.to_string()],
        // What is wrong with the problem is said where it is planned for again.
        Err(PlanningError::Pddl { .. }) => Vec::new(),
        Err(PlanningError::Problem(error)) if error.fault() == Fault::Input => Vec::new(),
        Err(error) => return Err(error.into()),
    };
    lines.iter().for_each(|line| context.output.note(line));
    Ok(State::Over(lines.join("\n")))
}

/// Waits for changes; returns how the watch ends where the user interrupts it, or the reader of stdout closes it.
fn wait(monitor: &mut Monitor<'_>, context: &mut Context<'_>) -> Result<Option<Exit>> {
    let guard = InterruptGuard::new();
    let is_interrupted = || guard.interrupted().load(Ordering::Relaxed);
    let closed = context.output.closed();
    let mut retried = |error: &_| context.output.warn(&format!("{error}; trying again"));
    let is_changed = monitor.wait(&|| is_interrupted() || closed(), &mut retried)?;
    let exit = if is_interrupted() { Exit::Interrupted } else { Exit::Done };
    Ok((!is_changed).then_some(exit))
}
