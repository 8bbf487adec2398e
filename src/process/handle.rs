//! rmem's end of a supervisor: starts it, waits for its report, and stops the program at a limit.

use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use tempfile::TempDir;

use super::end::End;
use super::host::{Host, Limits};
use super::job::{self, INPUT, Job, Mode};
use super::message::{Message, Usage};
use super::pool::Share;
use super::reading::{Printed, Reading, files};
use super::stale_files;
use super::supervisor::GRACE;
use super::usage;
use crate::formats::Source;
use crate::interrupt::Unfinished;

/// How often interruption, time and output are checked: a user does not notice the delay, and looking costs little.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// How long the supervisor may take to report beyond the grace, before it is killed.
const REPORT_TIMEOUT: Duration = Duration::from_secs(5);

/// rmem's end of the supervisor.
#[derive(Debug)]
pub(super) struct Supervisor {
    process: Child,
    lifeline: UnixStream,
    pending: String,
    /// The program's group.
    group: Option<Pid>,
    /// Whether the program may be running.
    is_running: bool,
    /// The run's directory, until it is removed: here, or by an interruption that ends rmem at once.
    directory: Option<(TempDir, Unfinished)>,
}

/// What a program left.
pub(super) struct Left {
    pub(super) stdout: Printed,
    pub(super) stderr: Printed,
    /// The wanted files, in their order.
    pub(super) files: Vec<Source>,
    /// Why reading was cut off, where it was.
    pub(super) cut: Option<End>,
}

impl Supervisor {
    pub(super) fn start(job: &Job<'_>, limits: &Limits, host: &Host<'_>) -> Result<Self, End> {
        let prefix = stale_files::prefix(&host.temporary, "rmem-run-");
        let make = || tempfile::Builder::new().prefix(&prefix).tempdir_in(&host.temporary);
        let (directory, unfinished) = Unfinished::making(make, |directory| vec![directory.path().to_owned()])
            .map_err(|error| End::no_files(host, &error))?;
        let (ours, theirs) = UnixStream::pair()?;
        let mut command = Command::new(&host.exe);
        command.arg("__supervisor").arg("--directory").arg(directory.path());
        if let Some(bytes) = limits.memory {
            command.arg("--memory").arg(bytes.to_string());
        }
        if let Mode::Attached(variables) = job.mode {
            command.arg("--attached").envs(variables.iter().copied());
        }
        if job.is_fed {
            command.arg("--input").arg(directory.path().join(INPUT));
        }
        if let Some(folder) = job.folder {
            command.arg("--folder").arg(std::path::absolute(folder)?);
        }
        command.arg("--").arg(job::located(job.program));
        command.args(job.arguments.iter().map(|word| job::filled(word, directory.path(), job.files)));
        if let Some(environment) = job.environment {
            command.env_clear().envs(environment.iter().copied());
        }
        command.current_dir(directory.path()).process_group(0);
        command.stdin(Stdio::from(OwnedFd::from(theirs)));
        if job.mode == Mode::Captured {
            command.stdout(stream(directory.path(), "stdout")?).stderr(stream(directory.path(), "stderr")?);
        }
        let process = command.spawn()?;
        let (pending, directory) = (String::new(), Some((directory, unfinished)));
        Ok(Self { process, lifeline: ours, pending, group: None, is_running: false, directory })
    }

    pub(super) fn place(&self) -> &Path {
        self.directory.as_ref().map_or(Path::new(""), |(directory, _)| directory.path())
    }

    /// Lets the program run.
    pub(super) fn release(&mut self) {
        self.is_running = true;
        // If the supervisor has ended, waiting for it notices.
        let _ = self.lifeline.write_all(b"go\n");
    }

    /// Waits for the end, and stops the program at a limit.
    pub(super) fn wait(
        &mut self,
        limits: &Limits,
        host: &Host<'_>,
        started: Instant,
        share: Option<Share<'_>>,
    ) -> (End, Option<Usage>) {
        // All ways out of here leave nothing running.
        self.is_running = false;
        let mut stopped: Option<(End, Instant)> = None;
        loop {
            let rest = limits.time.map(|time| time.saturating_sub(started.elapsed()));
            let timeout = rest.unwrap_or(POLL_INTERVAL).clamp(Duration::from_millis(1), POLL_INTERVAL);
            match self.receive(timeout) {
                Ok(Some(Message::Ended(end, usage))) => {
                    return (stopped.map_or(end, |(reason, _)| reason), Some(usage));
                }
                Ok(Some(Message::Started(group))) => self.group = group,
                Ok(None) => {
                    self.resume();
                    host.listener.receive(&self.place().join("stdout"));
                }
                Err(error) => {
                    self.abandon();
                    let gone = || End::SupervisorGone(format!("its supervisor is gone: {error}"));
                    return (stopped.map_or_else(gone, |(end, _)| end), None);
                }
            }
            match &stopped {
                None => {
                    if let Some(reason) = self.reason(limits, host, rest, share) {
                        let word: &[u8] = if reason == End::Starved { b"starve\n" } else { b"stop\n" };
                        let _ = self.lifeline.write_all(word);
                        stopped = Some((reason, Instant::now()));
                    }
                }
                Some((reason, since)) if since.elapsed() > GRACE + REPORT_TIMEOUT => {
                    let reason = reason.clone();
                    self.abandon();
                    return (reason, None);
                }
                Some(_) => {}
            }
        }
    }

    /// Why the program has to stop now.
    fn reason(
        &self,
        limits: &Limits,
        host: &Host<'_>,
        rest: Option<Duration>,
        share: Option<Share<'_>>,
    ) -> Option<End> {
        if host.is_interrupted() {
            return Some(End::Interrupted);
        }
        if rest.is_some_and(|rest| rest.is_zero()) {
            return Some(End::OutOfTime);
        }
        let has = |share: &Share<'_>| usage::resident(Pid::from_child(&self.process), self.group, share.limit());
        if share.is_some_and(|share| share.has_to_stop(has(&share))) {
            return Some(End::Starved);
        }
        let length = |name: &str| fs::metadata(self.place().join(name)).map_or(0, |file| file.len());
        (length("stdout").max(length("stderr")) > limits.output).then_some(End::TooMuchOutput)
    }

    /// The next message of the supervisor, waiting for at most `timeout`.
    fn receive(&mut self, timeout: Duration) -> io::Result<Option<Message>> {
        if !self.pending.contains('\n') {
            self.lifeline.set_read_timeout(Some(timeout))?;
            let mut buffer = [0; 256];
            match self.lifeline.read(&mut buffer) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(read) => self.pending.push_str(&String::from_utf8_lossy(buffer.get(..read).unwrap_or_default())),
                Err(error)
                    if matches!(
                        error.kind(),
                        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
                    ) =>
                {
                    return Ok(None);
                }
                Err(error) => return Err(error),
            }
        }
        let Some((line, rest)) = self.pending.split_once('\n') else { return Ok(None) };
        let message = Message::parse(line);
        self.pending = rest.to_owned();
        Ok(Some(message))
    }

    /// Continues a supervisor that was stopped (SIGSTOP): it could neither report nor enforce limits.
    fn resume(&self) {
        let supervisor = Pid::from_child(&self.process);
        if usage::is_stopped(supervisor) {
            let _ = kill_process(supervisor, Signal::CONT);
        }
    }

    /// Kills the program and the supervisor, when that does not answer.
    fn abandon(&mut self) {
        if let Some(group) = self.group {
            let _ = kill_process_group(group, Signal::KILL);
        }
        let _ = kill_process_group(Pid::from_child(&self.process), Signal::KILL);
    }

    /// Lets the supervisor kill the program, and waits for that.
    fn kill(&mut self) {
        let _ = self.lifeline.write_all(b"starve\n");
        let since = Instant::now();
        while since.elapsed() < REPORT_TIMEOUT {
            match self.receive(POLL_INTERVAL) {
                Ok(None) => self.resume(),
                Ok(Some(Message::Started(group))) => self.group = group,
                Ok(Some(Message::Ended(..))) => return,
                Err(_) => break,
            }
        }
        self.abandon();
    }

    /// Reads what the program left, removes the directory, and releases the supervisor.
    pub(super) fn collect(&mut self, most: u64, reading: &Reading<'_>, wanted: fn(&str) -> Option<u64>) -> Left {
        let stream = |name: &str| reading.text(self.place(), name, most).unwrap_or_default();
        let (stdout, stderr) = (stream("stdout"), stream("stderr"));
        let files = files(self.place(), reading, wanted);
        self.dismiss();
        Left { stdout, stderr, files, cut: reading.over() }
    }

    /// Removes the directory, and sends the supervisor that nothing more is needed.
    fn dismiss(&mut self) {
        // Where that fails, the result counts nevertheless: the supervisor tries it again, and later runs do.
        drop(self.directory.take());
        let _ = self.lifeline.write_all(b"done\n");
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        if self.is_running {
            self.kill();
        }
        self.dismiss();
        let _ = self.process.wait();
    }
}

/// A file for a stream; appended to, so that a program that seeks loses nothing.
fn stream(directory: &Path, name: &str) -> io::Result<Stdio> {
    File::options().create(true).append(true).open(directory.join(name)).map(Stdio::from)
}
