//! `rmem scene watch`: operations on the scene as they happen.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::selection::{Selection, leave_out};
use crate::commands::Context;
use crate::commands::query::blame;
use crate::commands::watch::retreat;
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::scene::Operation;
use crate::formats::scene::json::line;
use crate::formats::scene::message::write_operations;
use crate::output::Format;
use crate::scene::follow::{Event, Follower};

const HELP: &str = "\
Examples:
  rmem scene watch robmem.objects --frame map
  rmem scene watch --frame base_link --format moveit-msg --resume planner

Prints a line for each operation: add, remove, move, attach, detach, reshape; with --format moveit-msg a
PlanningScene with is_diff. A frame that moves moves every object in it. Poses are those of the frames as
they are when the line is printed. Starts with the next change: export the scene after the message on
stderr that it is following. Without --skip-invalid, an object that is invalid at the start is an error;
one that becomes invalid is removed, with a warning.

--resume NAME keeps in the memory how far it is, in each collection, and which objects it reported: a later
watch with that name continues there, and reports also what went with a collection that was dropped
meanwhile. After a crash, operations may be delivered again. The position in the first collection has
the name NAME, in others NAME:NS; rmem watch --names lists them, rmem watch NS --resume NAME --forget forgets one.";

/// Print operations as they happen
#[derive(Debug, Args)]
#[command(after_help = HELP)]
#[command(arg = crate::commands::formats::argument(&crate::commands::formats::SCENE_OPERATIONS))]
pub struct WatchArgs {
    #[command(flatten)]
    pub(super) selection: Selection,
    /// Continue where the last watch with this name ended; a new name starts now
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    resume: Option<String>,
    /// Exit after N operations; with --resume, the operations of the last change are complete
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// Exit after this time
    #[arg(long, value_name = "DURATION", value_parser = crate::formats::quantity::duration)]
    timeout: Option<Duration>,
}

/// How long to wait for changes before interruption and time are checked.
const POLL_INTERVAL: Duration = Duration::from_millis(250);

pub(super) fn run(args: &WatchArgs, context: &mut Context<'_>) -> Result<Exit> {
    let format = context.format(&crate::commands::formats::SCENE_OPERATIONS)?;
    let kinds = context.settings.object_kinds.clone();
    let sources = args.selection.sources(&kinds, context)?;
    let frames = args.selection.more.frames(&sources, context);
    let memory = context.memory()?;
    let guard = crate::interrupt::InterruptGuard::new();
    let frame = args.selection.frame.as_str();
    let follower = Follower::new(&memory, &sources, &frames, frame, args.resume.as_deref());
    let (mut follower, invalid) = follower.map_err(|error| blame(error, &[("<query>", &args.selection.query)]))?;
    if args.resume.is_none() {
        args.selection.more.report(&invalid, context)?;
    }
    context.output.note(&format!("following {} objects in the frame {frame}", follower.count()));
    // Objects that became invalid since the last watch are left out, as they are while one runs.
    if args.resume.is_some() {
        leave_out(&invalid, context);
    }
    let deadline = args.timeout.and_then(|timeout| Instant::now().checked_add(timeout));
    let (mut delivered, mut is_lost) = (0, false);
    loop {
        if let Some(exit) = verdict(args, delivered, deadline, guard.interrupted()) {
            return Ok(exit);
        }
        if (context.output.closed())() {
            return Ok(Exit::Done);
        }
        let left = deadline.map_or(POLL_INTERVAL, |deadline| deadline.saturating_duration_since(Instant::now()));
        let (invalid, mut operations) = match follower.next(left.min(POLL_INTERVAL))? {
            Event::Operations(operations) => (Vec::new(), operations),
            Event::Invalid(invalid, operations) => (invalid, operations),
            Event::Nothing => (Vec::new(), Vec::new()),
            Event::Interrupted(error) => {
                retreat(&error, &mut is_lost, context);
                continue;
            }
        };
        if std::mem::take(&mut is_lost) {
            context.output.note("following again");
        }
        leave_out(&invalid, context);
        // A watch with this name would not deliver the rest of a change that is done.
        if let Some(count) = args.count.filter(|_| args.resume.is_none()) {
            operations.truncate(usize::try_from(count - delivered).unwrap_or(usize::MAX));
        }
        delivered += print(&operations, frame, format, context)?;
        follower.done()?;
    }
}

/// How the watch ends, where it does.
fn verdict(args: &WatchArgs, delivered: u64, deadline: Option<Instant>, interrupted: &AtomicBool) -> Option<Exit> {
    if interrupted.load(Ordering::Relaxed) {
        return Some(Exit::Interrupted);
    }
    if args.count.is_some_and(|count| delivered >= count) {
        return Some(Exit::Done);
    }
    let is_over = deadline.is_some_and(|deadline| Instant::now() >= deadline);
    let is_enough = args.count.is_none() && delivered > 0;
    is_over.then_some(if is_enough { Exit::Done } else { Exit::No })
}

/// Prints operations at once; gives how many.
fn print(operations: &[Operation], frame: &str, format: Format, context: &mut Context<'_>) -> Result<u64> {
    for operation in operations {
        let text = match format {
            Format::MOVEIT_MESSAGE => write_operations(std::slice::from_ref(operation), Some(frame)),
            _ => line(&operation.to_document(Some(frame))) + "\n",
        };
        context.output.stdout().write_all(text.as_bytes())?;
    }
    context.output.flush()?;
    Ok(operations.len() as u64)
}
