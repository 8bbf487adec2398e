//! `rmem backend up|status|down`: the mongod processes of this robot.

use std::time::Duration;

use clap::{Args, Subcommand, ValueEnum};

use super::{Context, UsageError, formats};
use crate::exit::Exit;
use crate::formats::quantity;
use crate::settings::backend::Backend;

/// What stands below the help of `backend`.
const HELP: &str = "\
Examples:
  rmem backend up
  rmem backend status --format table
  rmem backend down shared";

/// Start, inspect and stop the mongod processes of this robot
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct BackendArgs {
    /// What to do with them.
    #[command(subcommand)]
    pub command: BackendCommand,
}

/// The commands of `backend`.
#[derive(Debug, Subcommand)]
pub enum BackendCommand {
    Up(BackendUpArgs),
    Status(BackendStatusArgs),
    Down(BackendDownArgs),
}

/// What stands below the help of `backend up`.
const UP_HELP: &str = "\
Examples:
  rmem backend up
  rmem backend up shared --wait 1m

Starts the mongod processes of [backend.local] and [backend.shared] in rmem.toml in the background; log and pid file \
are beside the data. A process that runs already is left as it is, so the command can be repeated at any time.

The first robot that reaches a majority of the members initiates the replica set; members that were added to the \
settings are added to the set. While a majority is missing, a warning names the missing members. With --wait, the \
command waits for them, and exits with 1 if they do not come.

The servers require no password; run them in the robots' own network only.";

/// Start the mongod processes that do not run, and initiate or join their replica sets
#[derive(Debug, Args)]
#[command(after_help = UP_HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct BackendUpArgs {
    /// local or shared (default: both)
    #[arg(value_name = "BACKEND", hide_possible_values = true)]
    pub backends: Vec<BackendName>,
    /// Wait at most this long until every replica set accepts writes
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub wait: Option<Duration>,
}

/// What stands below the help of `backend status`.
const STATUS_HELP: &str = "\
Examples:
  rmem backend status
  rmem backend status --format table

lag_seconds is how far a member is behind the primary; oplog_seconds is how long it can be away and still catch up \
from that member's log. Exits with 1 if a member is not up.";

/// Print the state, lag, operations log and version of each member
#[derive(Debug, Args)]
#[command(after_help = STATUS_HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct BackendStatusArgs {}

/// What stands below the help of `backend down`.
const DOWN_HELP: &str = "\
Examples:
  rmem backend down
  rmem backend down local

Exits with 1 if a mongod runs that rmem backend up did not start; that one is not stopped.";

/// Stop the mongod processes that `rmem backend up` started
#[derive(Debug, Args)]
#[command(after_help = DOWN_HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct BackendDownArgs {
    /// local or shared (default: both)
    #[arg(value_name = "BACKEND", hide_possible_values = true)]
    pub backends: Vec<BackendName>,
}

/// A table of `rmem.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BackendName {
    /// `[backend.local]`
    Local,
    /// `[backend.shared]`
    Shared,
}

impl BackendName {
    /// The name of the table.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Local => "local",
            Self::Shared => "shared",
        }
    }
}

#[cfg(feature = "mongodb")]
pub(super) fn run(args: &BackendArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    served::run(args, context)
}

#[cfg(not(feature = "mongodb"))]
pub(super) fn run(_: &BackendArgs, _: &mut Context<'_>) -> anyhow::Result<Exit> {
    let text = "this rmem was built without MongoDB; build it with `--features mongodb`";
    Err(UsageError::new(text).into())
}

/// The configured processes that are meant.
#[cfg_attr(not(feature = "mongodb"), expect(dead_code, reason = "without MongoDB there are none"))]
fn meant(names: &[BackendName], context: &Context<'_>) -> Result<Vec<Backend>, UsageError> {
    let all = &context.settings.backends;
    let file = context.settings.file.as_ref().map_or("rmem.toml".to_owned(), |path| path.display().to_string());
    if all.is_empty() {
        return Err(UsageError::new(format!(
            "no backend is configured; expected [backend.local] or [backend.shared] with port and path in {file}"
        )));
    }
    if let Some(missing) = names.iter().find(|name| all.iter().all(|backend| backend.name != name.name())) {
        return Err(UsageError::new(format!("there is no [backend.{}] in {file}", missing.name())));
    }
    let is_meant = |backend: &&Backend| names.is_empty() || names.iter().any(|name| name.name() == backend.name);
    Ok(all.iter().filter(is_meant).cloned().collect())
}

#[cfg(feature = "mongodb")]
mod served {
    use std::time::{Duration, Instant};

    use bson::{Document, doc};

    use super::{BackendArgs, BackendCommand, BackendName, BackendUpArgs, Context, Exit, meant};
    use crate::backend::{self, BackendError, Down, Row, Running, Settled};
    use crate::settings::backend::Backend;

    /// How often a set is asked whether a majority has come.
    const LOOK: Duration = Duration::from_millis(500);

    pub(super) fn run(args: &BackendArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
        let done = match &args.command {
            BackendCommand::Up(args) => up(args, context),
            BackendCommand::Status(_) => status(context),
            BackendCommand::Down(args) => down(&args.backends, context),
        };
        match done {
            Err(error) if matches!(error.downcast_ref(), Some(BackendError::NoProgram { .. })) => {
                context.output.error(&error.to_string());
                Ok(Exit::PlannerNotFound)
            }
            done => done,
        }
    }

    fn up(args: &BackendUpArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
        let since = Instant::now();
        let guard = args.wait.unwrap_or_default();
        let mut exit = Exit::Done;
        let mut rows = Vec::new();
        for backend in meant(&args.backends, context)? {
            let running = backend::up(&backend)?;
            if running.started && backend.is_open() {
                let text = format!("{} listens at {} and asks nobody for a password", backend.name, backend.bind);
                context.output.warn(&text);
            }
            let mut settled = backend::settle(&backend)?;
            while matches!(settled, Settled::Waiting { .. }) && since.elapsed() < guard {
                std::thread::sleep(LOOK);
                settled = backend::settle(&backend)?;
            }
            if let Some(text) = missing(&backend, &settled) {
                context.output.warn(&text);
                exit = if args.wait.is_some() { Exit::No } else { exit };
            }
            rows.push(started(&backend, running, &settled));
        }
        context.print_documents(rows.into_iter().map(Ok))?;
        Ok(exit)
    }

    /// What keeps the set from taking writes.
    fn missing(backend: &Backend, settled: &Settled) -> Option<String> {
        match settled {
            Settled::Ready { .. } => None,
            Settled::Copying => {
                Some(format!("a new member of the replica set `{}` is still copying what it has", backend.replica_set))
            }
            Settled::Waiting { silent } => Some(format!(
                "the replica set `{}` takes no writes yet: of {} members, {} do not answer: {}; run `rmem backend up` there",
                backend.replica_set,
                backend.members.len(),
                silent.len(),
                silent.join(", ")
            )),
        }
    }

    fn started(backend: &Backend, running: Running, settled: &Settled) -> Document {
        let state = match settled {
            Settled::Ready { state, .. } => state,
            Settled::Copying => "COPYING",
            Settled::Waiting { .. } => "WAITING",
        };
        doc! {
            "backend": backend.name,
            "address": backend.address(),
            "set": &backend.replica_set,
            "pid": running.pid,
            "started": running.started,
            "state": state,
        }
    }

    fn status(context: &mut Context<'_>) -> anyhow::Result<Exit> {
        let backends = meant(&[], context)?;
        let asked: Vec<_> = std::thread::scope(|scope| {
            let asked: Vec<_> = backends.iter().map(|backend| scope.spawn(|| backend::status(backend))).collect();
            asked.into_iter().filter_map(|asked| asked.join().ok()).collect()
        });
        let rows = asked.into_iter().collect::<Result<Vec<_>, _>>()?.concat();
        let up = rows.iter().all(Row::is_up);
        context.print_documents(rows.into_iter().map(|row| Ok(member(row))))?;
        Ok(if up { Exit::Done } else { Exit::No })
    }

    fn member(row: Row) -> Document {
        doc! {
            "backend": row.backend,
            "set": row.set,
            "member": row.member,
            "own": row.own,
            "state": row.state,
            "lag_seconds": row.lag,
            "oplog_seconds": row.oplog.map(i64::from),
            "version": row.version,
            "pid": row.pid,
        }
    }

    fn down(names: &[BackendName], context: &mut Context<'_>) -> anyhow::Result<Exit> {
        let mut exit = Exit::Done;
        let mut rows = Vec::new();
        for backend in meant(names, context)? {
            let (pid, did) = match backend::down(&backend)? {
                Down::Stopped(pid) => (pid, "stopped"),
                Down::Absent => (None, "not running"),
                Down::Foreign(pid) => {
                    let text = format!("{} was not started by `rmem backend up`, and is left alone", backend.name);
                    context.output.warn(&text);
                    exit = Exit::No;
                    (pid, "left alone")
                }
            };
            rows.push(doc! { "backend": backend.name, "address": backend.address(), "pid": pid, "did": did });
        }
        context.print_documents(rows.into_iter().map(Ok))?;
        Ok(exit)
    }
}
