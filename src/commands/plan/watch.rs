//! `rmem plan --watch`: plans again when the memory has changed and the plan does not hold any more.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use bson::{Document, doc};

use super::check::judge;
use super::pose::Sections;
use super::run::{Found, PlanRequest, find};
use crate::commands::Context;
use crate::exit::Exit;
use crate::memory::Memory;
use crate::memory::watch::{Trigger, Watch};
use crate::plan::{Archive, ArchiveError, Status};
use crate::store::{Namespace, Next};

/// How long nothing is looked at but the memory.
const SLICE: Duration = Duration::from_millis(250);
/// How long nothing may change before the plan is looked at: an action changes more than one document.
const QUIET: Duration = Duration::from_millis(150);
/// How long changes may go on before the plan is looked at nevertheless.
const RESTLESS: Duration = Duration::from_secs(2);
/// How long one waits before a store is looked for again.
const RETREAT: Duration = Duration::from_millis(500);

pub(super) fn run(mut order: PlanRequest<'_>, memory: &Memory, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let found = find(&order, memory, context)?;
    let steps = steps(&order.effort.into, memory)?;
    let mut watches = Watches { memory, steps, asked: Vec::new(), delay: Duration::ZERO, looks: Vec::new() };
    watches.add(&found.namespaces)?;
    let names: Vec<String> = found.namespaces.iter().map(Namespace::to_string).collect();
    let mut current = match plan_of(found) {
        Ok(current) => current,
        Err(exit) => return Ok(exit),
    };
    order.sections = Sections::Unsaid;
    context.output.flush()?;
    context.output.note(&format!("watching {}", names.join(", ")));
    loop {
        // At first, what changed while the plan was made; then, what changed since.
        if !still_holds(current.as_deref(), &order, memory, context)? {
            order.rerun_of = current.take().or(order.rerun_of);
            match find(&order, memory, context) {
                Ok(found) => {
                    let more = watches.add(&found.namespaces)?;
                    match plan_of(found) {
                        Ok(found) => current = found,
                        Err(exit) => return Ok(exit),
                    }
                    if more {
                        // What changed before they were watched has been heard by nobody.
                        continue;
                    }
                }
                // The world may be one that has no problem at the moment.
                Err(error) if Exit::of(&error) == Exit::BadInput => context.output.warn(&format!("no plan: {error:#}")),
                Err(error) => return Err(error),
            }
            context.output.flush()?;
        }
        if !changed(&mut watches, context)? {
            return Ok(Exit::Interrupted);
        }
    }
}

/// What is listened to.
struct Watches<'a> {
    memory: &'a Memory,
    /// The steps that somebody notes as begun or ended.
    steps: Watch<'a>,
    /// What the problem is made from.
    asked: Vec<(Namespace, Watch<'a>)>,
    /// How long caches of computables may hold what was before a change.
    delay: Duration,
    /// When to look again though nothing more has changed, the last first.
    looks: Vec<Instant>,
}

impl Watches<'_> {
    /// Listens to collections from now on, too; says whether it did not do so before.
    fn add(&mut self, namespaces: &[Namespace]) -> anyhow::Result<bool> {
        let before = self.asked.len();
        let sources = self.memory.sources(namespaces);
        for namespace in sources.namespaces {
            if !self.asked.iter().any(|(other, _)| *other == namespace) {
                let watch = watch(&namespace, Document::new(), self.memory)?;
                self.asked.push((namespace, watch));
            }
        }
        self.delay = self.delay.max(sources.delay);
        Ok(self.asked.len() > before)
    }

    /// Notes that something has changed: what is computed of it is seen once the caches are over, and
    /// what is computed of that, once more.
    fn note(&mut self) {
        if !self.delay.is_zero() {
            let now = Instant::now();
            self.looks = [2, 1].iter().filter_map(|times| now.checked_add(self.delay * *times + QUIET)).collect();
        }
    }

    /// Whether it is time to look again.
    fn is_due(&mut self) -> bool {
        let is_due = self.looks.last().is_some_and(|look| Instant::now() >= *look);
        if is_due {
            self.looks.pop();
        }
        is_due
    }
}

/// Every change of the documents of a collection but of those that computables make.
fn watch<'a>(namespace: &Namespace, filter: Document, memory: &'a Memory) -> anyhow::Result<Watch<'a>> {
    let trigger = Trigger { namespace: namespace.clone(), filter, name: None, computed: false, metadata: false };
    Ok(memory.watch(trigger)?)
}

/// Every change of a plan; what changed in the world during a step is looked at when it has ended.
fn steps<'a>(plans: &Namespace, memory: &'a Memory) -> anyhow::Result<Watch<'a>> {
    watch(plans, doc! { "plan": { "$nin": ["fail", 0] } }, memory)
}

/// The plan that was found, or that there is none now; what another world would not help ends the watch.
fn plan_of(found: Found) -> Result<Option<String>, Exit> {
    match found.exit {
        Exit::Done => Ok(Some(found.id)),
        Exit::Unsolvable | Exit::GaveUp | Exit::OutOfTime | Exit::OutOfMemory => Ok(None),
        exit => Err(exit),
    }
}

/// Whether the plan still reaches its goal, or an action of it is under way; says why not.
fn still_holds(
    current: Option<&str>,
    order: &PlanRequest<'_>,
    memory: &Memory,
    context: &mut Context<'_>,
) -> anyhow::Result<bool> {
    let Some(id) = current else { return Ok(false) };
    let record = match Archive::new(memory, &order.effort.into).get(id) {
        Ok(record) => record,
        Err(ArchiveError::Store(error)) => return Err(error.into()),
        Err(gone) => {
            context.output.note(&gone.to_string());
            return Ok(false);
        }
    };
    // While an action is under way, the world is neither as before nor as after it.
    if record.progress().iter().any(|step| step.status == Status::Running) {
        return Ok(true);
    }
    let verdict = judge(&record, None, memory, context)?;
    if verdict.holds() {
        return Ok(true);
    }
    verdict.tell(id).iter().for_each(|line| context.output.note(line));
    Ok(false)
}

/// Waits until something has changed and all is quiet again; false where somebody interrupts.
fn changed(watches: &mut Watches<'_>, context: &mut Context<'_>) -> anyhow::Result<bool> {
    let guard = crate::InterruptGuard::new();
    let is_over = || guard.interrupted().load(Ordering::Relaxed);
    while !any_change(watches, SLICE, context)? {
        if is_over() {
            return Ok(false);
        }
        if watches.is_due() {
            return Ok(true);
        }
    }
    watches.note();
    let start = Instant::now();
    while start.elapsed() < RESTLESS && !is_over() && any_change(watches, QUIET, context)? {}
    Ok(!is_over())
}

/// Whether a change comes in a time, which the collections share.
fn any_change(watches: &mut Watches<'_>, time: Duration, context: &mut Context<'_>) -> anyhow::Result<bool> {
    let share = time / u32::try_from(watches.asked.len() + 1).unwrap_or(u32::MAX);
    let mut any = false;
    for watch in watches.asked.iter_mut().map(|(_, watch)| watch).chain([&mut watches.steps]) {
        let mut share = share;
        loop {
            match watch.next(share)? {
                Next::Change(_) => any = true,
                Next::Nothing => break,
                Next::Interrupted(error) => {
                    context.output.warn(&format!("{error}; trying again"));
                    std::thread::sleep(RETREAT);
                    break;
                }
            }
            // What is there already is taken along.
            share = Duration::ZERO;
        }
        watch.done()?;
    }
    Ok(any)
}
