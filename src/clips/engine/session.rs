//! Programs from their loading to their end.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::job::{Ended, Job};
use super::message::Sender;
use super::native::{Environment, Running, Stream};
use super::program::{self, Part};
use super::state::State;
use super::stop::Stop;
use super::{exchange, functions, subscription};
use crate::error::Result;
use crate::formats::clips::{Item, Reader};
use crate::formats::{Diagnostic, Diagnostics, Source, Span};
use crate::input::WrongInput;
use crate::memory::Memory;

/// How many rules fire before changes of the memory are looked for.
const BURST: u64 = 100;
/// How deep lists may be nested in a program: CLIPS reads them recursively.
const MAX_DEPTH: usize = 10_000;

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
        if let Some(place) = too_deep(program.text()) {
            let message = format!("expected lists nested at most {MAX_DEPTH} deep");
            complaints.push(Diagnostic::new(program, Span::at(place), message));
            continue;
        }
        for part in program::parts(program.text()) {
            match part {
                Part::Constructs(span) => complaints.extend(constructs(program, span, clips, state)),
                Part::Command(span) => {
                    is_reset |= program.slice(span).trim_start_matches('(').trim_start().starts_with("reset");
                    complaints.extend(command(program, span, clips, state));
                }
            }
            if state.stop().is_due() {
                break;
            }
        }
    }
    if complaints.is_empty() { Ok(is_reset) } else { Err(Diagnostics(complaints).into()) }
}

/// Loads constructs; returns what is wrong with them.
fn constructs(program: &Source, span: Span, clips: &Environment, state: &State<'_>) -> Vec<Diagnostic> {
    let mut complaints = Vec::new();
    // CLIPS counts the lines of what it is given.
    let before = program.text().get(..span.start).unwrap_or_default().matches('\n').count();
    let text = format!("{}{}", "\n".repeat(before), program.slice(span));
    let good = state.while_loading(|| clips.load(&text));
    for (line, doubtful, text) in state.take_mistakes() {
        let complaint = Diagnostic::new(program, line_span(program.text(), line), sentence(&text));
        if doubtful {
            state.sender().note(complaint.to_string());
        } else {
            complaints.push(complaint);
        }
    }
    if !good && complaints.is_empty() && !state.stop().is_due() {
        complaints.push(Diagnostic::new(program, Span::at(span.start), "expected constructs that CLIPS can load"));
    }
    complaints
}

/// Runs a command; returns what is wrong with it.
fn command(program: &Source, span: Span, clips: &Environment, state: &State<'_>) -> Option<Diagnostic> {
    let (good, printed) = state.while_commanding(|| clips.command(program.slice(span)));
    let failed = !good || clips.has_failed();
    if state.stop().is_due() {
        return None;
    }
    clips.recover();
    if failed {
        let first = printed.lines().find(|line| !line.trim().is_empty()).unwrap_or("CLIPS cannot run this command");
        return Some(Diagnostic::new(program, span, first.trim()));
    }
    state.sender().write(Stream::Err, printed.as_bytes());
    None
}

/// The message of CLIPS on a mistake, without the construct that it repeats.
fn sentence(text: &str) -> String {
    let text = text.split_once("\nERROR:").map_or(text, |(text, _)| text);
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A line, from 1, without the blanks around it; the last one where there are fewer.
fn line_span(text: &str, line: usize) -> Span {
    let mut start = 0;
    let mut found = Span::at(0);
    for (nth, content) in text.split_inclusive('\n').enumerate() {
        let indent = content.len() - content.trim_start().len();
        if !content.trim().is_empty() {
            found = Span::new(start + indent, start + content.trim_end().len());
        }
        if nth + 1 >= line {
            break;
        }
        start += content.len();
    }
    found
}

/// Where lists are nested too deeply.
fn too_deep(text: &str) -> Option<usize> {
    let (mut depth, mut quoted, mut escaped, mut remark) = (0_usize, false, false, false);
    for (place, byte) in text.bytes().enumerate() {
        match byte {
            _ if escaped => escaped = false,
            b'\n' if remark => remark = false,
            _ if remark => {}
            b'\\' if quoted => escaped = true,
            b'"' => quoted = !quoted,
            _ if quoted => {}
            b';' => remark = true,
            b'(' => depth += 1,
            b')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > MAX_DEPTH {
            return Some(place);
        }
    }
    None
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
