//! `rmem backend up|status|down`, where rmem was built with MongoDB.

use std::time::{Duration, Instant};

use bson::{Document, doc};

use super::args::{BackendName, DownArgs, UpArgs};
use crate::backend::{self, Down, Row, Running, Settled};
use crate::commands::{Context, UsageError};
use crate::error::Result;
use crate::exit::Exit;
use crate::settings::backend::Backend;

/// How often a set is asked whether it has a majority: an election takes seconds.
const POLL_INTERVAL: Duration = Duration::from_millis(500);

pub(super) fn up(args: &UpArgs, context: &mut Context<'_>) -> Result<Exit> {
    let since = Instant::now();
    let guard = args.wait.unwrap_or_default();
    let mut exit = Exit::Done;
    let mut rows = Vec::new();
    for backend in meant(&args.backends, context)? {
        let running = backend::up(&backend)?;
        if running.started && backend.is_open() {
            let text = format!("{} listens at {} and requires no password", backend.name, backend.bind);
            context.output.warn(&text);
        }
        let mut settled = backend::settle(&backend)?;
        while matches!(settled, Settled::Waiting { .. }) && since.elapsed() < guard {
            std::thread::sleep(POLL_INTERVAL);
            settled = backend::settle(&backend)?;
        }
        if let Some(text) = missing(&backend, &settled) {
            context.output.warn(&text);
            exit = if args.wait.is_some() { Exit::No } else { exit };
        }
        rows.push(started(&backend, running, &settled));
    }
    context.print_rows(rows.into_iter().map(Ok))?;
    Ok(exit)
}

/// What keeps the set from taking writes.
fn missing(backend: &Backend, settled: &Settled) -> Option<String> {
    match settled {
        Settled::Up { .. } => None,
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
        Settled::Up { state, .. } => state,
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

pub(super) fn status(context: &mut Context<'_>) -> Result<Exit> {
    let backends = meant(&[], context)?;
    let asked: Vec<_> = std::thread::scope(|scope| {
        let asked: Vec<_> = backends.iter().map(|backend| scope.spawn(|| backend::status(backend))).collect();
        asked.into_iter().filter_map(|asked| asked.join().ok()).collect()
    });
    let (rows, problems): (Vec<_>, Vec<_>) = asked.into_iter().map(|status| (status.rows, status.problem)).unzip();
    let rows = rows.concat();
    let up = rows.iter().all(Row::is_up);
    context.print_rows(rows.into_iter().map(|row| Ok(member(row))))?;
    if let Some(problem) = problems.into_iter().flatten().next() {
        return Err(problem.into());
    }
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

pub(super) fn down(args: &DownArgs, context: &mut Context<'_>) -> Result<Exit> {
    let mut exit = Exit::Done;
    let mut rows = Vec::new();
    for backend in meant(&args.backends, context)? {
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
    context.print_rows(rows.into_iter().map(Ok))?;
    Ok(exit)
}

/// The configured processes that are meant.
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
