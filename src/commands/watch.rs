//! `rmem watch NS [QUERY]`: triggers.

mod delivery;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bson::{Document, doc};
use clap::Args;
use clap::builder::NonEmptyStringValueParser;
use delivery::{Delivered, Delivery};

use super::Context;
use super::query::{argument, blame};
use crate::exit::Exit;
use crate::formats::quantity;
use crate::memory::watch::{Trigger, Watch};
use crate::store::{Name, Namespace, Next, StoreError};

/// What stands below the help of `watch`.
const HELP: &str = "\
Examples:
  rmem watch robmem.worldmodel \"{relation: 'on'}\"
  rmem watch robmem.plans \"{plan: 'success'}\" --resume executive --exec ./execute-plan.sh
  rmem watch robmem.orders --count 1 --timeout 30s
  rmem watch --names
  rmem watch robmem.plans --resume executive --forget

Prints a line for each change, in order: {operation, ns, _id, before, after, time, position}. The
operation is insert, update, replace, delete, or drop (the collection is gone; what restore --drop,
a rename or $out puts in its place follows as inserts). The query is matched against the document
after the change, before it for a deletion. Begins with what happens from now on; once it is ready
it says so on stderr.

--resume NAME keeps in the memory how far it is: who uses the name later goes on there, and misses
nothing; after a crash, changes may be delivered again: those of the last moment, or of the last
seconds where others write without a pause. One process at a time has a name (exit code 5). Changes
are kept for names until they are delivered, up to 256 MiB in a file and as long as the oplog on
MongoDB; a name that missed some says so. Forget names that nobody uses any more with --forget;
--names lists all with what waits for each. On MongoDB they are documents in rmem.watchers of the
watched database, a collection that no list and no dump of all has.

--exec runs CMD with sh -c for each change, one at a time: the line on stdin, RMEM_OPERATION,
RMEM_NAMESPACE and RMEM_POSITION in the environment. Where it fails, rmem says so and goes on; with
--resume it ends with the command's exit code, and begins with the same change the next time. What
the command leaves in the background lives on, unless rmem is killed while the command runs.

--format clips prints facts for (load-facts), each document as JSON in a string, and with
--resume NAME the ordered fact (NAME) too. CLIPS has to know their template:

(deftemplate robmem-trigger
   (slot name (type STRING))
   (multislot rcvd-at (type INTEGER) (cardinality 2 2))
   (slot operation (type SYMBOL))
   (slot namespace (type STRING))
   (slot id (type STRING))
   (slot before (type STRING))
   (slot after (type STRING)))

Ends with 0 after --count changes; with 1 when --timeout is over and there were fewer (without
--count: none); a command that still runs then is ended (TERM, two seconds later KILL), and its
change does not count. A MongoDB server has to be a replica set, which one member can be; the
collection is made to keep images of its documents before and after changes (and made, where it is
missing).";

/// Follow the changes of a collection: triggers
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct WatchArgs {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS", required_unless_present = "names")]
    pub namespace: Option<Namespace>,
    /// Of which documents; all where it is left out
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Run CMD for each change instead of printing it
    #[arg(long, value_name = "CMD")]
    pub exec: Option<String>,
    /// Go on where the last one of this name was done; a new name starts now
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub resume: Option<String>,
    /// Only forget the name
    #[arg(long, requires = "resume", conflicts_with_all = ["exec", "count", "timeout"])]
    pub forget: bool,
    /// Only list the names, who uses each, and what is kept for it
    #[arg(long, conflicts_with_all = ["namespace", "query", "exec", "resume", "count", "timeout", "computed", "meta"])]
    pub names: bool,
    /// End after N changes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// End after so long
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub timeout: Option<Duration>,
    /// Deliver documents that computables made, too
    #[arg(long)]
    pub computed: bool,
    /// Show the memory's metadata, `_robmem_info`
    #[arg(long)]
    pub meta: bool,
}

/// How long nothing is looked at but the memory.
const SLICE: Duration = Duration::from_millis(250);
/// How long after a change was printed its position is kept at the latest; a kept
/// position is a durable write, and more than one change may be behind it.
const LAG: Duration = Duration::from_millis(100);
/// How long nothing more comes until the position is kept earlier.
const LULL: Duration = Duration::from_millis(20);
/// How long one waits before a store is looked for again.
const RETREAT: Duration = Duration::from_millis(500);

pub(super) fn run(args: &WatchArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    // The command line has one or the other.
    let Some(namespace) = &args.namespace else { return names(context) };
    let delivery = Delivery::new(args, namespace, context)?;
    let trigger = trigger(args, namespace)?;
    let memory = context.memory()?;
    if let (true, Some(name)) = (args.forget, &args.resume) {
        return Ok(if memory.forget_watch(namespace, name)? { Exit::Done } else { Exit::No });
    }
    let timeout = crate::interrupt::InterruptGuard::new();
    let watch = memory.watch(trigger).map_err(|error| blame(error, &[("<query>", &args.query)]))?;
    context.report_operations();
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

fn trigger(args: &WatchArgs, namespace: &Namespace) -> anyhow::Result<Trigger> {
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
    args: &'a WatchArgs,
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

#[cfg(test)]
mod tests {
    #[test]
    fn the_help_shows_the_template_of_the_facts() {
        assert!(super::HELP.contains(crate::clips::facts::TRIGGER));
    }
}
