//! `rmem watch NS [QUERY]`: triggers.

mod delivery;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bson::{Document, doc};

use super::Context;
use super::query::{argument, blame};
use crate::cli;
use crate::exit::Exit;
use crate::memory::watch::{Trigger, Watch};
use crate::store::{Name, Namespace, Next, StoreError};
use delivery::{Delivered, Delivery};

/// How long nothing is looked at but the memory.
const SLICE: Duration = Duration::from_millis(250);
/// How long after a change was printed its position is kept at the latest; a kept
/// position is a durable write, and more than one change may be behind it.
const LAG: Duration = Duration::from_millis(100);
/// How long nothing more comes until the position is kept earlier.
const LULL: Duration = Duration::from_millis(20);
/// How long one waits before a store is looked for again.
const RETREAT: Duration = Duration::from_millis(500);

pub(super) fn run(args: &cli::Watch, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    // The command line has one or the other.
    let Some(namespace) = &args.namespace else { return names(context) };
    let delivery = Delivery::new(args, namespace, context)?;
    let trigger = trigger(args, namespace)?;
    let memory = context.memory()?;
    if let (true, Some(name)) = (args.forget, &args.resume) {
        return Ok(if memory.forget_watch(namespace, name)? { Exit::Done } else { Exit::No });
    }
    let timeout = crate::InterruptGuard::new();
    let watch = memory.watch(trigger).map_err(|error| blame(error, &[("<query>", &args.query)]))?;
    context.output.tell_operations();
    context.output.note(&format!("watching {namespace}"));
    let session = Session {
        args,
        namespace,
        delivery,
        watch,
        stop: timeout.interrupted(),
        delivered: 0,
        behind: false,
        kept: None,
    };
    session.follow(context)
}

/// Lists the names of watches.
fn names(context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let names = context.memory()?.watch_names()?;
    context.print_documents(names.iter().map(|name| Ok(listed(name))))?;
    Ok(Exit::Done)
}

fn listed(name: &Name) -> Document {
    let number = |number: u64| i64::try_from(number).unwrap_or(i64::MAX);
    doc! {
        "name": &name.name,
        "ns": name.namespace.to_string(),
        "process": name.process.map(i64::from),
        "missed": name.missed,
        "waiting": name.waiting.map(|waiting| number(waiting.changes)),
        "bytes": name.waiting.map(|waiting| number(waiting.bytes)),
    }
}

fn trigger(args: &cli::Watch, namespace: &Namespace) -> anyhow::Result<Trigger> {
    Ok(Trigger {
        namespace: namespace.clone(),
        filter: argument("<query>", &args.query)?,
        name: args.resume.clone(),
        computed: args.computed,
        metadata: args.meta,
    })
}

/// What is followed, and how far it is.
struct Session<'a> {
    args: &'a cli::Watch,
    namespace: &'a Namespace,
    delivery: Delivery<'a>,
    watch: Watch<'a>,
    stop: &'a AtomicBool,
    delivered: u64,
    /// Whether something was delivered since the position was kept.
    behind: bool,
    kept: Option<Instant>,
}

impl Session<'_> {
    /// Delivers changes until there were enough, the time is over, or somebody interrupts.
    fn follow(mut self, context: &mut Context<'_>) -> anyhow::Result<Exit> {
        let mut lost = false;
        loop {
            if let Some(exit) = self.verdict() {
                self.watch.done()?;
                return Ok(exit);
            }
            let mut quiet = false;
            match self.next()? {
                Next::Change(change) => {
                    (self.delivered, self.behind) = (self.delivered + 1, true);
                    match self.delivery.deliver(&change, &mut self.watch, self.stop, context)? {
                        Delivered::Well if self.args.exec.is_some() => self.watch.done()?,
                        Delivered::Well => {}
                        Delivered::Badly(code) if self.args.resume.is_some() => return Ok(Exit::Passed(code)),
                        Delivered::Badly(_) => {}
                        Delivered::Interrupted => {
                            self.delivered -= 1;
                            return Ok(self.verdict().unwrap_or(Exit::Interrupted));
                        }
                    }
                }
                Next::Nothing => quiet = true,
                Next::Interrupted(error) => {
                    retreat(&error, &mut lost, context);
                    continue;
                }
            }
            if std::mem::take(&mut lost) {
                context.output.note(&format!("watching {} again", self.namespace));
            }
            self.keep(quiet)?;
        }
    }

    fn next(&mut self) -> anyhow::Result<Next> {
        let slice = if self.behind { LULL } else { SLICE };
        let left = self.delivery.deadline.map_or(slice, |deadline| deadline.saturating_duration_since(Instant::now()));
        self.watch.next(left.min(slice)).map_err(|error| blame(error, &[("<query>", &self.args.query)]))
    }

    /// Keeps the position, where nothing more comes for now or it was not kept for long.
    fn keep(&mut self, quiet: bool) -> anyhow::Result<()> {
        if quiet || self.kept.is_none_or(|kept| kept.elapsed() >= LAG) {
            self.watch.done()?;
            (self.kept, self.behind) = (Some(Instant::now()), false);
        }
        Ok(())
    }

    /// How it ends, where it does.
    fn verdict(&self) -> Option<Exit> {
        if self.stop.load(Ordering::Relaxed) {
            return Some(Exit::Interrupted);
        }
        if self.args.count.is_some_and(|count| self.delivered >= count) {
            return Some(Exit::Done);
        }
        let over = self.delivery.deadline.is_some_and(|deadline| Instant::now() >= deadline);
        let enough = self.args.count.is_none() && self.delivered > 0;
        over.then_some(if enough { Exit::Done } else { Exit::No })
    }
}

/// Says once that the store is lost, and waits a moment.
fn retreat(error: &StoreError, lost: &mut bool, context: &mut Context<'_>) {
    if !std::mem::replace(lost, true) {
        context.output.warn(&format!("{error}; trying again"));
    }
    std::thread::sleep(RETREAT);
}
