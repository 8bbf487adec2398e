//! Delivering a change: a line on stdout, or a command that is run.

use std::io::Write as _;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use bson::Document;
use rustix::process::{Pid, Signal, kill_process_group};

use crate::cli;
use crate::commands::{Context, WrongInput};
use crate::facts;
use crate::formats::clips::{write_fact, write_value};
use crate::formats::shell;
use crate::memory::watch::{Watch, event};
use crate::output::Format;
use crate::store::{Change, Namespace};

/// How often a running command is looked after.
const SLICE: Duration = Duration::from_millis(100);
/// How long a command that is told to end may take.
const GRACE: Duration = Duration::from_secs(2);

/// How changes are delivered.
pub(super) struct Delivery<'a> {
    namespace: &'a Namespace,
    name: Option<&'a str>,
    exec: Option<&'a str>,
    /// When a running command is ended.
    deadline: Option<Instant>,
    format: Format,
}

/// How a delivery went.
pub(super) enum Delivered {
    /// It is printed, or the command succeeded.
    Well,
    /// The command failed, with this code.
    Badly(u8),
    /// Somebody interrupted, or the time is over, and the command was ended.
    Interrupted,
}

impl<'a> Delivery<'a> {
    pub(super) fn new(args: &'a cli::Watch, context: &Context<'_>) -> anyhow::Result<Self> {
        let format = context.format(&[Format::Jsonl, Format::Canonical, Format::Clips])?;
        let deadline = args.timeout.and_then(|timeout| Instant::now().checked_add(timeout));
        let (name, exec) = (args.resume.as_deref(), args.exec.as_deref());
        Ok(Self { namespace: &args.namespace, name, exec, deadline, format })
    }

    /// Delivers one change, and tells how long that took.
    pub(super) fn deliver(
        &self,
        change: &Change,
        watch: &mut Watch<'_>,
        stop: &AtomicBool,
        context: &mut Context<'_>,
    ) -> anyhow::Result<Delivered> {
        let start = Instant::now();
        let event = event(self.namespace, change)?;
        let text = self.text(&event)?;
        let delivered = match self.exec {
            None => {
                context.output.stdout().write_all(text.as_bytes())?;
                context.output.flush()?;
                Delivered::Well
            }
            Some(line) => {
                let mut command = self.command(line, change);
                run(&mut command, text, watch, stop, self.deadline)?
            }
        };
        let id = event.get("_id").map(shell::relaxed_value).unwrap_or_default();
        let outcome = match delivered {
            Delivered::Badly(code) => {
                let operation = change.kind.name();
                context.output.warn(&format!("the command for {operation} {id} ended with {code}"));
                format!(" failed with {code}")
            }
            _ => String::new(),
        };
        let detail = format!("{} {id}{outcome}", change.kind.name());
        context.output.operation("trigger", &self.namespace.to_string(), &detail, start.elapsed());
        Ok(delivered)
    }

    /// What is printed, or given to the command: whole lines.
    fn text(&self, event: &Document) -> anyhow::Result<String> {
        let mut text = String::new();
        match self.format {
            Format::Clips => {
                let facts = facts::trigger(self.name, event, facts::now())
                    .map_err(|error| WrongInput::new(format!("{}: {error}", self.namespace)))?;
                for fact in facts {
                    write_fact(&fact, write_value, &mut text);
                    text.push('\n');
                }
            }
            Format::Canonical => text = shell::canonical(event) + "\n",
            _ => text = shell::relaxed(event) + "\n",
        }
        Ok(text)
    }

    fn command(&self, line: &str, change: &Change) -> Command {
        let mut command = Command::new("sh");
        command
            .args(["-c", line])
            .env("RMEM_OPERATION", change.kind.name())
            .env("RMEM_NAMESPACE", self.namespace.to_string())
            .env("RMEM_POSITION", &change.position)
            .stdin(Stdio::piped())
            .process_group(0);
        command
    }
}

/// Runs a command with `text` on its stdin until it ends, somebody interrupts, or the time is over.
fn run(
    command: &mut Command,
    text: String,
    watch: &mut Watch<'_>,
    stop: &AtomicBool,
    deadline: Option<Instant>,
) -> anyhow::Result<Delivered> {
    let mut child = command.spawn().context("cannot run sh")?;
    let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    if let Some(mut stdin) = child.stdin.take() {
        // A command that does not read all of it closes its stdin; that is its business.
        std::thread::spawn(move || drop(stdin.write_all(text.as_bytes())));
    }
    let (sender, ended) = channel();
    std::thread::spawn(move || drop(sender.send(child.wait())));
    let mut told = None;
    loop {
        match ended.recv_timeout(SLICE) {
            Ok(_) if told.is_some() => return Ok(Delivered::Interrupted),
            Ok(status) => return Ok(verdict(status.context("cannot wait for the command")?)),
            Err(RecvTimeoutError::Disconnected) => anyhow::bail!("cannot wait for the command"),
            Err(RecvTimeoutError::Timeout) => {}
        }
        watch.renew()?;
        let is_over = deadline.is_some_and(|deadline| Instant::now() >= deadline);
        if !stop.load(Ordering::Relaxed) && !is_over {
            continue;
        }
        let since = *told.get_or_insert_with(Instant::now);
        let signal = if since.elapsed() < GRACE { Signal::TERM } else { Signal::KILL };
        // A group that has just ended needs no signal.
        let _ = group.map(|group| kill_process_group(group, signal));
    }
}

/// What the shell would say of it.
fn verdict(status: ExitStatus) -> Delivered {
    match (status.code(), status.signal()) {
        (Some(0), _) => Delivered::Well,
        (Some(code), _) => Delivered::Badly(u8::try_from(code).unwrap_or(u8::MAX)),
        (None, signal) => Delivered::Badly(u8::try_from(128 + signal.unwrap_or_default()).unwrap_or(u8::MAX)),
    }
}
