//! Delivering a change: a line on stdout, or a command that is run.

use std::ffi::OsStr;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use bson::Document;

use crate::clips::facts;
use crate::commands::{Context, WrongInput};
use crate::error::{Error, Result};
use crate::formats::clips::{write_fact, write_value};
use crate::formats::shell;
use crate::memory::watch::Watch;
use crate::output::Format;
use crate::process::{self, End, Host, INPUT, Job, Limits, Mode};
use crate::store::{Namespace, StoreError};

/// How often to check whether a running command has ended or is to be interrupted.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// How changes are delivered.
pub(super) struct Delivery<'a> {
    pub(super) namespace: &'a Namespace,
    /// The name of `--resume`.
    pub(super) name: Option<&'a str>,
    /// The command of `--exec`.
    pub(super) exec: Option<&'a str>,
    /// When the watch is over, and a running command is ended.
    pub(super) deadline: Option<Instant>,
    pub(super) format: Format,
}

/// How a delivery went.
pub(super) enum Delivered {
    /// It is printed, or the command succeeded.
    Well,
    /// The command failed, with this code.
    Badly(u8),
    /// An interrupt or the timeout stopped the command.
    Interrupted,
}

impl<'a> Delivery<'a> {
    /// Delivers an event, and reports how long that took.
    pub(super) fn deliver(
        &self,
        event: &Document,
        watch: &mut Watch<'_>,
        stop: &AtomicBool,
        context: &mut Context<'_>,
    ) -> Result<Delivered> {
        let start = Instant::now();
        let operation = event.get_str("operation").unwrap_or_default();
        let text = self.text(event)?;
        let delivered = match self.exec {
            None => {
                context.output.stdout().write_all(text.as_bytes())?;
                context.output.flush()?;
                Delivered::Well
            }
            Some(line) => self.run(line, event, &text, watch, stop, &context.host())?,
        };
        let id = event.get("_id").map(shell::relaxed_value).unwrap_or_default();
        let outcome = match delivered {
            Delivered::Badly(code) => {
                context.output.warn(&format!("the command for {operation} {id} ended with {code}"));
                format!(" failed with {code}")
            }
            _ => String::new(),
        };
        let detail = format!("{operation} {id}{outcome}");
        context.output.operation("trigger", &self.namespace.to_string(), &detail, start.elapsed());
        Ok(delivered)
    }

    /// What is printed, or given to the command: whole lines.
    fn text(&self, event: &Document) -> Result<String> {
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
            Format::Json => text = shell::pretty(&event.clone().into()) + "\n",
            Format::Canonical => text = shell::canonical(event) + "\n",
            _ => text = shell::relaxed(event) + "\n",
        }
        Ok(text)
    }

    /// Runs the command for a change, with `text` on its stdin.
    fn run(
        &self,
        line: &str,
        event: &Document,
        text: &str,
        watch: &mut Watch<'_>,
        stop: &AtomicBool,
        host: &Host<'_>,
    ) -> Result<Delivered> {
        let namespace = self.namespace.to_string();
        let variables = [
            ("RMEM_OPERATION", event.get_str("operation").unwrap_or_default()),
            ("RMEM_NAMESPACE", &namespace),
            ("RMEM_POSITION", event.get_str("position").unwrap_or_default()),
        ];
        let job = Job {
            program: OsStr::new("sh"),
            arguments: &["-c".into(), line.into()],
            files: &[],
            is_fed: true,
            folder: Some(Path::new(".")),
            environment: None,
            mode: Mode::Attached(&variables),
            wanted: |_| None,
        };
        let time = self.deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
        verdict(attend(&job, text, &Limits { time, ..Limits::default() }, host, watch, stop)?)
    }
}

/// Runs a program to its end or to an interrupt, with a heartbeat of the watch meanwhile.
fn attend(
    job: &Job<'_>,
    text: &str,
    limits: &Limits,
    host: &Host<'_>,
    watch: &mut Watch<'_>,
    stop: &AtomicBool,
) -> Result<End, StoreError> {
    let quit = AtomicBool::new(false);
    let host = Host { interrupted: &quit, ..host.clone() };
    std::thread::scope(|scope| {
        let (sender, ended) = channel();
        let host = &host;
        let running = scope.spawn(move || drop(sender.send(process::run(job, &[(INPUT, text)], limits, host).end)));
        loop {
            match ended.recv_timeout(POLL_INTERVAL) {
                Ok(end) => return Ok(end),
                Err(RecvTimeoutError::Disconnected) => return Ok(End::Failed("it was lost".to_owned())),
                Err(RecvTimeoutError::Timeout) => {}
            }
            let renewed = watch.renew();
            if renewed.is_err() || stop.load(Ordering::Relaxed) {
                quit.store(true, Ordering::Relaxed);
            }
            if renewed.is_err() {
                // Whoever has the name now runs the command for the same change: this one ends first.
                let _ = running.join();
                return renewed.map(|()| End::Interrupted);
            }
        }
    })
}

/// What the shell would say of it.
fn verdict(end: End) -> Result<Delivered> {
    let code = match end {
        End::Exited(code) => code,
        End::Signalled(signal) => 128 + signal,
        End::Interrupted | End::OutOfTime => return Ok(Delivered::Interrupted),
        End::Missing => return Err(unrunnable("there is no sh")),
        End::NoInterpreter(_) | End::Starved | End::TooMuchOutput => return Err(unrunnable("it was stopped")),
        End::NoFiles(words) | End::SupervisorGone(words) | End::Failed(words) => return Err(unrunnable(&words)),
    };
    Ok(if code == 0 { Delivered::Well } else { Delivered::Badly(u8::try_from(code).unwrap_or(u8::MAX)) })
}

fn unrunnable(words: &str) -> Error {
    Error::from(std::io::Error::other(words.to_owned())).context("cannot run the command of --exec")
}
