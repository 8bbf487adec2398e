//! `rmem watch NS [QUERY]`: triggers.

mod condition;
mod delivery;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bson::{Document, doc};
use clap::Args;
use clap::builder::NonEmptyStringValueParser;
use condition::{Condition, Counting};
use delivery::{Delivered, Delivery};

use super::query::{blame, filter_of};
use super::{Context, UsageError, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{nearest, quantity};
use crate::memory::Memory;
use crate::memory::watch::{Trigger, Watch, event};
use crate::output::Format;
use crate::saturate::to_i64;
use crate::settings::Origin;
use crate::store::{Name, Namespace, Next, StoreError, StoreUri};

/// The formats of changes.
const FORMATS: [Format; 4] = [Format::Jsonl, Format::Json, Format::Canonical, Format::Clips];

/// What stands below the help of `watch`.
const HELP: &str = "\
Examples:
  rmem watch robmem.worldmodel \"{relation: 'on'}\"
  rmem watch robmem.plans \"{plan: 'success'}\" --resume executive --exec ./execute-plan.sh
  rmem watch robmem.orders --count 1 --timeout 30s
  rmem watch robmem.orders \"{state: 'open'}\" --when \"count > 3\"
  rmem watch --names
  rmem watch robmem.plans --resume executive --forget

Prints a line for each change, in order: {operation, ns, _id, before, after, time, position}. The operation is \
insert, update, replace, delete, or drop (of the collection). The query is matched against the document after the \
change, for a deletion against the document before it. Delivery starts with the next change; a message on stderr \
says when.

--resume NAME keeps the position in the memory: the next watch with this name continues there, and no change is \
missed. After a crash, the last changes may be delivered again. Only one process at a time can use a name (exit code \
5). Changes are kept until they are delivered: in a file up to 256 MiB, on MongoDB as long as the oplog; a watch that \
missed changes reports it. --names lists the names and what waits for each, --forget removes one. On MongoDB, the \
positions are in the collection rmem.watchers of the watched database.

--when prints an event when the number of documents that match the query begins to meet a condition (>, >=, <, <=, ==, \
!=), also at the start: {operation: 'count', ns, count, when, time}. Documents are counted after each change; changes \
in quick succession are counted once.

--exec runs CMD with sh -c for each change, one at a time, with the line on stdin and RMEM_OPERATION, RMEM_NAMESPACE \
and RMEM_POSITION in the environment. If CMD fails, rmem reports it and continues; with --resume it exits with the \
code of CMD, and starts with the same change next time. Background processes of CMD keep running, unless rmem is \
killed while CMD runs.

--format clips prints facts for (load-facts): the documents as JSON strings, and with --resume NAME also the ordered \
fact (NAME). CLIPS needs their template:

(deftemplate robmem-trigger
   (slot name (type STRING))
   (multislot rcvd-at (type INTEGER) (cardinality 2 2))
   (slot operation (type SYMBOL))
   (slot namespace (type STRING))
   (slot id (type STRING))
   (slot before (type STRING))
   (slot after (type STRING)))

Exits with 0 after --count changes. When --timeout is over, exits with 1 if there were fewer changes (without --count: \
none); a running CMD is terminated (TERM, after two seconds KILL), and its change does not count.

A MongoDB server has to be a replica set; one member suffices. rmem enables before and after images on the \
collection, and creates it if it is missing.";

/// Print changes as they happen, or run a command for each
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&FORMATS))]
pub struct WatchArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS", required_unless_present = "names")]
    pub namespace: Option<Namespace>,
    /// Query that selects documents (default: all documents)
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Run CMD for each change instead of printing it
    #[arg(long, value_name = "CMD")]
    pub exec: Option<String>,
    /// Continue where the last watch with this name ended; a new name starts now
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub resume: Option<String>,
    /// Remove the name of --resume, and deliver nothing
    #[arg(long, requires = "resume", conflicts_with_all = ["exec", "count", "timeout"])]
    pub forget: bool,
    /// List the names of --resume, the process that uses each, and what waits for it
    #[arg(long, conflicts_with_all = ["namespace", "query", "exec", "resume", "count", "timeout", "computed", "meta"])]
    pub names: bool,
    /// Deliver an event when the number of matching documents begins to meet a condition, e.g. "count > 3"
    #[arg(long, value_name = "CONDITION", value_parser = Condition::parse, conflicts_with_all = ["resume", "computed", "meta", "names"])]
    pub when: Option<Condition>,
    /// Exit after N changes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Exit after this time
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub timeout: Option<Duration>,
    /// Deliver documents of computables, too
    #[arg(long)]
    pub computed: bool,
    /// Show the metadata of documents, under `_robmem_info`
    #[arg(long)]
    pub meta: bool,
}

/// How long to wait for changes before interruption and time are checked.
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// How long after a change was printed its position is kept at the latest; a kept
/// position is a durable write, and more than one change may be behind it.
const MAX_POSITION_DELAY: Duration = Duration::from_millis(100);
/// How long nothing more comes until the position is kept earlier.
const QUIET_TIME: Duration = Duration::from_millis(20);
/// How long to wait before a store that cannot be reached is tried again.
const RETRY_DELAY: Duration = Duration::from_millis(500);

pub(super) fn run(args: &WatchArgs, context: &mut Context<'_>) -> Result<Exit> {
    // The command line has one or the other.
    let Some(namespace) = &args.namespace else { return names(context) };
    let delivery = Delivery {
        namespace,
        name: args.resume.as_deref(),
        exec: args.exec.as_deref(),
        deadline: args.timeout.and_then(|timeout| Instant::now().checked_add(timeout)),
        format: context.format(&FORMATS)?,
    };
    if args.when.is_some() && delivery.format == Format::Clips {
        return Err(UsageError::new("--when has no facts; expected --format jsonl, json or canonical").into());
    }
    let filter = filter_of(namespace, &args.query)?;
    let trigger = trigger(args, namespace, &filter);
    let is_new = new_file(context);
    let memory = context.memory()?;
    if let (true, Some(name)) = (args.forget, &args.resume) {
        let is_known = memory.forget_watch(namespace, name)?;
        crate::scene::reported::forget(&memory, namespace, name)?;
        if !is_known {
            let message =
                format!("no watch of {namespace} has the name `{name}`; `rmem watch --names` lists those there are");
            context.output.error(&message);
            return Ok(Exit::No);
        }
        return Ok(Exit::Done);
    }
    let guard = crate::interrupt::InterruptGuard::new();
    let counting =
        args.when.map(|condition| Counting { condition, memory: &memory, filter: &filter, changed: None, held: false });
    let watch = memory.watch(trigger).map_err(|error| blame(error, &[("<query>", &args.query)]))?;
    context.report_operations();
    // What is watched may be there later only, or be misspelt.
    match is_new {
        Some(message) => context.output.warn(&message),
        None => drop(missing::warn_of_nearest(namespace, &memory, context)),
    }
    context.output.note(&format!("watching {namespace}"));
    if let Some(message) = computed(args, namespace, &filter, &memory)? {
        context.output.warn(&message);
    }
    let session = Session {
        args,
        namespace,
        delivery,
        watch,
        stop: guard.interrupted(),
        delivered: 0,
        behind: false,
        kept: None,
        counting,
    };
    session.follow(context)
}

/// Says that the file of a memory that the user names does not exist yet, and which one may be meant.
fn new_file(context: &Context<'_>) -> Option<String> {
    let memory = &context.settings.memory;
    let is_named = matches!(memory.origin, Origin::Flag(_) | Origin::Environment(_));
    let uri = StoreUri::parse(memory.value.as_deref().filter(|_| is_named)?).ok()?;
    let path = uri.path().filter(|path| !path.exists())?;
    let name = path.file_name()?.to_string_lossy().into_owned();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let files = std::fs::read_dir(folder).ok()?.flatten().filter(|entry| entry.path().is_file());
    let files: Vec<String> = files.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    let meant = nearest(&name, files.iter().map(String::as_str)).map(|file| format!("; did you mean {file}?"));
    Some(format!("{} did not exist yet{}", path.display(), meant.unwrap_or_default()))
}

/// Says which computables answer the query, for what they give is no change of the memory.
fn computed(
    args: &WatchArgs,
    namespace: &Namespace,
    filter: &Document,
    memory: &Memory,
) -> Result<Option<String>, StoreError> {
    let needed = memory.needed(namespace, filter)?;
    let names: Vec<String> = needed.iter().map(|computable| format!("`{}`", computable.definition.name)).collect();
    let (noun, verb) = if names.len() == 1 { ("computable", "answers") } else { ("computables", "answer") };
    let seen = match args.when {
        Some(_) => format!("--when counts what is computed as well, whenever {namespace} changes, and only then"),
        None if args.computed => return Ok(None),
        None => "watch delivers changes of stored documents only".to_owned(),
    };
    Ok((!names.is_empty()).then(|| format!("the {noun} {} {verb} this query: {seen}", names.join(", "))))
}

/// Lists the names of watches.
fn names(context: &mut Context<'_>) -> Result<Exit> {
    let names = context.memory()?.watch_names()?;
    context.print_rows(names.iter().map(|name| Ok(listed(name))))?;
    Ok(Exit::Done)
}

fn listed(name: &Name) -> Document {
    let number = to_i64::<u64>;
    doc! {
        "name": &name.name,
        "ns": name.namespace.to_string(),
        "process": name.process.map(i64::from),
        "missed": name.missed,
        "waiting": name.waiting.map(|waiting| number(waiting.changes)),
        "bytes": name.waiting.map(|waiting| number(waiting.bytes)),
    }
}

/// What is watched: the documents of the query; where they are counted, all, since one may stop to match.
fn trigger(args: &WatchArgs, namespace: &Namespace, filter: &Document) -> Trigger {
    Trigger {
        namespace: namespace.clone(),
        filter: if args.when.is_some() { Document::new() } else { filter.clone() },
        name: args.resume.clone(),
        computed: args.computed,
        metadata: args.meta,
    }
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
    /// What is counted, where counts are delivered instead of changes.
    counting: Option<Counting<'a>>,
}

impl Session<'_> {
    /// Delivers changes until there were enough, the time is over, or an interrupt.
    fn follow(mut self, context: &mut Context<'_>) -> Result<Exit> {
        let mut lost = false;
        if let Some(counting) = &mut self.counting {
            // What is there at the start may meet the condition.
            counting.changed = Some(Instant::now());
        }
        loop {
            if let Some(exit) = self.verdict() {
                self.watch.done()?;
                return Ok(exit);
            }
            if self.args.exec.is_none() && (context.output.closed())() {
                self.watch.done()?;
                return Ok(Exit::Done);
            }
            let mut quiet = false;
            match self.next()? {
                Next::Change(change) => {
                    self.behind = true;
                    match &mut self.counting {
                        Some(counting) => drop(counting.changed.get_or_insert_with(Instant::now)),
                        None => {
                            let event = event(self.namespace, &change)?;
                            if let Some(exit) = self.deliver(&event, context)? {
                                return Ok(exit);
                            }
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
            let count = |counting: &mut Counting<'_>| {
                let is_due = counting.changed.is_some_and(|changed| quiet || changed.elapsed() >= MAX_POSITION_DELAY);
                if is_due { counting.event(self.namespace) } else { Ok(None) }
            };
            let event = self.counting.as_mut().map(count).transpose();
            let event = event.map_err(|error| blame(error, &[("<query>", &self.args.query)]))?.flatten();
            if let Some(event) = event
                && let Some(exit) = self.deliver(&event, context)?
            {
                return Ok(exit);
            }
            self.keep(quiet)?;
        }
    }

    /// Delivers an event; returns how the watch ends, where it does.
    fn deliver(&mut self, event: &Document, context: &mut Context<'_>) -> Result<Option<Exit>> {
        self.delivered += 1;
        match self.delivery.deliver(event, &mut self.watch, self.stop, context)? {
            Delivered::Well if self.args.exec.is_some() => self.watch.done()?,
            Delivered::Badly(code) if self.args.resume.is_some() => return Ok(Some(Exit::Passed(code))),
            Delivered::Well | Delivered::Badly(_) => {}
            Delivered::Interrupted => {
                self.delivered -= 1;
                return Ok(Some(self.verdict().unwrap_or(Exit::Interrupted)));
            }
        }
        Ok(None)
    }

    fn next(&mut self) -> Result<Next> {
        let slice = if self.behind { QUIET_TIME } else { POLL_INTERVAL };
        let left = self.delivery.deadline.map_or(slice, |deadline| deadline.saturating_duration_since(Instant::now()));
        self.watch.next(left.min(slice)).map_err(|error| blame(error, &[("<query>", &self.args.query)]))
    }

    /// Keeps the position, where nothing more comes for now or it was not kept for long.
    fn keep(&mut self, quiet: bool) -> Result<()> {
        if quiet || self.kept.is_none_or(|kept| kept.elapsed() >= MAX_POSITION_DELAY) {
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
pub(super) fn retreat(error: &StoreError, lost: &mut bool, context: &mut Context<'_>) {
    if !std::mem::replace(lost, true) {
        context.output.warn(&format!("{error}; trying again"));
    }
    std::thread::sleep(RETRY_DELAY);
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_help_shows_the_template_of_the_facts() {
        assert!(super::HELP.contains(crate::clips::facts::TRIGGER));
    }
}
