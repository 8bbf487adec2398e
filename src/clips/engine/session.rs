//! Programs from their loading to their end.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::job::{Ended, Job};
use super::message::Sender;
use super::native::{Environment, Running};
use super::program;
use super::state::State;
use super::stop::Stop;
use super::{exchange, functions, load, subscription};
use crate::error::Result;
use crate::formats::clips::{Item, Reader};
use crate::formats::{Diagnostic, Diagnostics, Source};
use crate::input::WrongInput;
use crate::memory::Memory;

/// How many rules fire before changes of the memory are looked for.
const BURST: u64 = 100;

/// Loads programs, asserts facts, and fires rules until the run is over.
pub(super) fn run(job: &Job, deadline: Option<Instant>, memory: &Memory, sender: &Sender) -> Result<Ended> {
    let state = Rc::new(State::new(memory, sender, job, Stop::new(job.interrupted, deadline)));
    let mut clips = Running::new(Rc::clone(&state) as Rc<_>).ok_or_else(|| WrongInput::new("CLIPS does not start"))?;
    let own = program::functions(&job.programs);
    functions::define(&mut clips, &state, &|name| own.iter().any(|(own, _)| own == name)).map_err(WrongInput::new)?;
    replace(&own, &clips, sender);
    clips.load(subscription::TEMPLATE);
    let deep = AtomicBool::new(false);
    let stop = Rc::clone(&state);
    let stop = stop.stop();
    let ended = clips.watched(&|| stop.is_due(), &deep, || {
        if !load(&job.programs, &clips, &state)? {
            clips.reset();
        }
        assert(&job.facts, &clips)?;
        state.begin(&clips)?;
        follow(job.cycles, &clips, &state)
    });
    state.finish();
    if deep.load(Ordering::Relaxed) {
        clips.complain("[RMEM2] Functions call themselves too deeply; the run was ended.");
    }
    // Documents and watches belong to the memory, and go before it does.
    drop(clips);
    ended
}

/// Lets functions of programs take the place of those that have their names: of rmem's, and of those that CLIPS 6.40 has
/// and the CLIPS of the program had not.
fn replace(own: &BTreeSet<(String, String)>, clips: &Environment, sender: &Sender) {
    let mut replaced: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (name, program) in own {
        let is_new = program::NEW.contains(&name.as_str());
        if is_new {
            clips.remove_function(name);
        }
        if is_new || functions::is_defined(name) {
            replaced.entry(program).or_default().push(name);
        }
    }
    for (program, names) in replaced {
        sender.note(format!("{program} has functions of its own in place of rmem's and CLIPS': {}", names.join(", ")));
    }
}

/// Loads the programs, all of them, so that all mistakes are reported; returns whether one of them resets CLIPS.
fn load(programs: &[Source], clips: &Environment, state: &State<'_>) -> Result<bool> {
    let (mut complaints, mut is_reset) = (Vec::new(), false);
    for program in programs {
        let loaded = load::program(program, clips, state);
        complaints.extend(loaded.complaints);
        is_reset |= loaded.is_reset;
    }
    if complaints.is_empty() { Ok(is_reset) } else { Err(Diagnostics(complaints).into()) }
}

/// Asserts the facts of texts, all of one text or none.
fn assert(texts: &[Source], clips: &Environment) -> Result<()> {
    for source in texts {
        let mut facts = Vec::new();
        for item in Reader::new(source, clips.templates()) {
            if let Item::Fact(fact) = item? {
                facts.push(fact);
            }
        }
        let schema = exchange::schema(clips, facts.iter().map(|fact| fact.name.as_str()));
        for fact in &facts {
            exchange::check(fact, &schema).map_err(|misfit| Diagnostic::new(source, misfit.span, misfit.message))?;
        }
        for fact in &facts {
            exchange::assert(fact, clips).map_err(|message| Diagnostic::new(source, fact.span, message))?;
        }
    }
    Ok(())
}

/// Fires rules, and asserts changes of the memory, until nothing more can happen.
fn follow(cycles: Option<u64>, clips: &Environment, state: &State<'_>) -> Result<Ended> {
    let (mut left, mut is_idle) = (cycles, false);
    loop {
        if let Some(ended) = verdict(clips, state) {
            return Ok(ended);
        }
        let received = state.receive(clips, is_idle)?;
        let burst = if state.is_subscribed() { Some(BURST) } else { None };
        let limit = [left, burst].into_iter().flatten().min();
        let fired = clips.run(limit);
        state.wm_facts.push(state, clips);
        left = left.map(|left| left.saturating_sub(fired));
        if let Some(ended) = verdict(clips, state) {
            return Ok(ended);
        }
        if left == Some(0) || clips.is_halted() {
            return Ok(Ended::Well);
        }
        is_idle = fired == 0 && !received;
        if is_idle && !state.is_subscribed() {
            return Ok(Ended::Well);
        }
        if is_idle {
            state.sender().flush();
        }
    }
}

/// How it ends, where it does.
fn verdict(clips: &Environment, state: &State<'_>) -> Option<Ended> {
    if let Some(code) = state.exited() {
        return Some(Ended::Exited(code));
    }
    let stop = state.stop();
    if stop.is_interrupted() {
        return Some(Ended::Interrupted);
    }
    if stop.is_over() {
        return Some(if state.is_resting() { Ended::Well } else { Ended::OutOfTime });
    }
    clips.has_failed().then_some(Ended::Failed)
}
