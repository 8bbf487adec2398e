//! A run of a program: its directory, its supervisor, its limits, and its result.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::fs::OpenOptionsExt as _;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use tempfile::TempDir;

use super::host::{Host, Limits};
use super::litter;
use super::pool::Share;
use super::supervisor::GRACE;
use super::usage;
use crate::formats::Source;

/// The file in the run's directory that the program reads as standard input.
pub(crate) const INPUT: &str = "stdin";

/// How often interruption, time and output are checked.
const LOOK: Duration = Duration::from_millis(20);

/// How long the supervisor may take to report beyond the grace, before it is killed.
const REPORT_TIMEOUT: Duration = Duration::from_secs(5);

/// How long reading the result may take when the time of the run is over.
const COLLECT_TIMEOUT: Duration = Duration::from_secs(2);

/// A limit of memory, in bytes, under which death by a signal counts as lack of
/// memory: it is not enough for a program and its libraries.
const SMALL: u64 = 64 << 20;

/// How much of a file is read or written between two looks at the clock.
const PIECE: usize = 1 << 20;

/// How much of the output of a program that printed too much is read, in bytes.
const SAMPLE: u64 = 64 << 10;

/// The largest file that is read, in bytes.
const LARGEST_FILE: u64 = 16 << 20;

/// A program to run, in a directory made for the run.
pub(crate) struct Job<'a> {
    pub(crate) program: &'a OsStr,
    pub(crate) arguments: &'a [OsString],
    /// Files in the run's directory: what stands for one in the arguments, and its name there.
    pub(crate) files: &'a [(&'a str, &'a str)],
    /// Whether the program reads [`INPUT`]; else it has nothing on standard input.
    pub(crate) is_fed: bool,
    /// Where the program runs, where that is not the run's directory.
    pub(crate) folder: Option<&'a Path>,
    /// The whole environment, where it is not rmem's.
    pub(crate) environment: Option<&'a [(&'a str, &'a str)]>,
    /// How it runs.
    pub(crate) mode: Mode<'a>,
    /// Which of the files it leaves are wanted: where one stands among them, by its name.
    pub(crate) wanted: fn(&str) -> Option<u64>,
}

/// How a program runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode<'a> {
    /// For rmem: its output is captured, and nothing that it started outlives it.
    Captured,
    /// For the user: it has rmem's standard streams and these additional variables, and may leave something in
    /// the background when it ends by itself.
    Attached(&'a [(&'a str, &'a str)]),
}

/// How a program ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum End {
    Exited(i32),
    Signalled(i32),
    OutOfTime,
    TooMuchOutput,
    Interrupted,
    /// Its processes together had more memory than they may.
    Starved,
    /// There is no such program.
    Missing,
    /// It is a script for an interpreter that is not there.
    NoInterpreter(String),
    /// The files of the run could not be made: a fault of this machine, not of the program.
    NoFiles(String),
    /// Its supervisor ended before it.
    SupervisorGone(String),
    /// It could not be run at all.
    Failed(String),
}

impl End {
    /// Why it could not be run to an end of its own, where that is so.
    fn failure(&self) -> Option<&str> {
        match self {
            Self::NoFiles(words) | Self::SupervisorGone(words) | Self::Failed(words) => Some(words),
            _ => None,
        }
    }
}

impl From<io::Error> for End {
    fn from(error: io::Error) -> Self {
        Self::Failed(error.to_string())
    }
}

/// A program that has ended.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) end: End,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    /// The wanted files it left, in their order.
    pub(crate) files: Vec<Source>,
    pub(crate) wall: Duration,
    /// The processor time of all its processes, if the supervisor reported it.
    pub(crate) cpu: Option<Duration>,
    /// The most memory that its processes had resident, in bytes: of one of them, or of all at once, where there is a limit of
    /// memory and as far as it was seen.
    pub(crate) resident: Option<u64>,
    /// It ran into the limit of memory.
    pub(crate) out_of_memory: bool,
    /// It is ending already, and is waited for on drop.
    supervisor: Option<Supervisor>,
}

impl Ended {
    /// The exit code, where there is one.
    pub(crate) fn code(&self) -> Option<i32> {
        match self.end {
            End::Exited(code) => Some(code),
            _ => None,
        }
    }
}

impl Default for Ended {
    fn default() -> Self {
        Self {
            end: End::Failed(String::new()),
            stdout: String::new(),
            stderr: String::new(),
            files: Vec::new(),
            wall: Duration::ZERO,
            cpu: None,
            resident: None,
            out_of_memory: false,
            supervisor: None,
        }
    }
}

/// Runs a program to its end or its limits. The texts are those of files in its directory, by their names.
pub(crate) fn run(job: &Job<'_>, texts: &[(&str, &str)], limits: &Limits, host: &Host<'_>) -> Ended {
    Prepared::new(job, limits, host).run(texts, None, host)
}

/// A program that waits for its input; its processes and its directory exist already, and
/// are removed on drop.
#[derive(Debug)]
pub(crate) struct Prepared {
    /// An error is reported when it is to run.
    supervisor: Result<Supervisor, End>,
    limits: Limits,
    wanted: fn(&str) -> Option<u64>,
    /// Whether its result is read also after an interruption.
    is_kept: bool,
}

impl Prepared {
    pub(crate) fn new(job: &Job<'_>, limits: &Limits, host: &Host<'_>) -> Self {
        Self { supervisor: Supervisor::start(job, limits, host), limits: *limits, wanted: job.wanted, is_kept: false }
    }

    /// The same program, whose result is read also where an interruption ends it.
    pub(crate) fn kept(self) -> Self {
        Self { is_kept: true, ..self }
    }

    /// Runs it to its end or its limits; the time counts from here. `share` is its part in a limit of memory
    /// that several runs share. When this returns, neither its processes nor its directory are left; only the
    /// supervisor may still be on its way out, until what has [`Ended`] is dropped.
    pub(crate) fn run(self, texts: &[(&str, &str)], share: Option<Share<'_>>, host: &Host<'_>) -> Ended {
        self.attempt(texts, share, host).unwrap_or_else(|end| Ended { end, ..Ended::default() })
    }

    fn attempt(self, texts: &[(&str, &str)], share: Option<Share<'_>>, host: &Host<'_>) -> Result<Ended, End> {
        let (mut supervisor, limits) = (self.supervisor?, self.limits);
        for (name, text) in texts {
            write(&supervisor.place().join(name), text, host).map_err(|error| unmade(host, &error))?;
        }
        if host.is_interrupted() {
            return Ok(Ended { end: End::Interrupted, ..Ended::default() });
        }
        let started = Instant::now();
        supervisor.release();
        let (end, usage) = supervisor.wait(&limits, host, started, share);
        if let Some(share) = share {
            share.release();
        }
        let rest = limits.time.map(|time| time.saturating_sub(started.elapsed()).max(COLLECT_TIMEOUT));
        let is_kept = self.is_kept && end == End::Interrupted;
        let rest = if is_kept { Some(COLLECT_TIMEOUT) } else { rest };
        let reading = Reading { host, is_kept, deadline: rest.map(|rest| Instant::now() + rest) };
        let most = if end == End::TooMuchOutput { SAMPLE } else { limits.output };
        let mut ended = supervisor.collect(most, &reading, self.wanted);
        ended.wall = started.elapsed();
        ended.cpu = usage.as_ref().map(|usage| usage.cpu);
        ended.resident = usage.as_ref().map(|usage| usage.resident << 10).filter(|bytes| *bytes > 0);
        let peak = usage.map_or(0, |usage| usage.peak);
        ended.out_of_memory =
            end == End::Starved || limits.memory.is_some_and(|limit| starved(&end, &ended, peak, limit));
        // Reading that was cut off has its own end; otherwise the program's end counts.
        ended.end = match ended.end {
            End::Failed(_) => end,
            cut => cut,
        };
        Ok(ended)
    }
}

/// Returns that the files of a run cannot be made.
fn unmade(host: &Host<'_>, error: &io::Error) -> End {
    // The name of the file is rmem's own.
    let reason = io::Error::from(error.kind());
    let advice = if error.kind() == io::ErrorKind::NotFound { "create the folder" } else { "free space there" };
    let folder = host.temporary.display();
    End::NoFiles(format!("no files can be made for a run in {folder}: {reason}; {advice}, or set TMPDIR"))
}

/// Writes a file, unless rmem is interrupted.
fn write(path: &Path, text: &str, host: &Host<'_>) -> io::Result<()> {
    let mut file = File::create_new(path)?;
    for piece in text.as_bytes().chunks(PIECE) {
        if host.is_interrupted() {
            break;
        }
        file.write_all(piece)?;
    }
    Ok(())
}

/// rmem's end of the supervisor.
#[derive(Debug)]
struct Supervisor {
    process: Child,
    lifeline: UnixStream,
    pending: String,
    /// The program's group.
    group: Option<Pid>,
    /// The run's directory, until it is removed.
    directory: Option<TempDir>,
}

/// A message of the supervisor.
enum Message {
    Nothing,
    Ended(End, Usage),
}

/// What a program used.
#[derive(Debug, Clone, Copy, Default)]
struct Usage {
    /// Address space at most, in KiB.
    peak: u64,
    /// Processor time.
    cpu: Duration,
    /// Resident memory at most, of one process or of all as far as they were looked at, in KiB.
    resident: u64,
}

impl Supervisor {
    fn start(job: &Job<'_>, limits: &Limits, host: &Host<'_>) -> Result<Self, End> {
        let directory = tempfile::Builder::new()
            .prefix(&litter::prefix(&host.temporary, "rmem-run-"))
            .tempdir_in(&host.temporary)
            .map_err(|error| unmade(host, &error))?;
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
        command.arg("--").arg(located(job.program));
        command.args(job.arguments.iter().map(|word| filled(word, directory.path(), job.files)));
        if let Some(environment) = job.environment {
            command.env_clear().envs(environment.iter().copied());
        }
        command.current_dir(directory.path()).process_group(0);
        command.stdin(Stdio::from(OwnedFd::from(theirs)));
        if job.mode == Mode::Captured {
            command.stdout(stream(directory.path(), "stdout")?).stderr(stream(directory.path(), "stderr")?);
        }
        let process = command.spawn()?;
        Ok(Self { process, lifeline: ours, pending: String::new(), group: None, directory: Some(directory) })
    }

    fn place(&self) -> &Path {
        self.directory.as_ref().map_or(Path::new(""), TempDir::path)
    }

    /// Lets the program run.
    fn release(&mut self) {
        // If the supervisor has ended, waiting for it notices.
        let _ = self.lifeline.write_all(b"go\n");
    }

    /// Waits for the end, and stops the program at a limit.
    fn wait(
        &mut self,
        limits: &Limits,
        host: &Host<'_>,
        started: Instant,
        share: Option<Share<'_>>,
    ) -> (End, Option<Usage>) {
        let mut stopped: Option<(End, Instant)> = None;
        loop {
            let rest = limits.time.map(|time| time.saturating_sub(started.elapsed()));
            let timeout = rest.unwrap_or(LOOK).clamp(Duration::from_millis(1), LOOK);
            match self.receive(timeout) {
                Ok(Message::Ended(end, usage)) => return (stopped.map_or(end, |(reason, _)| reason), Some(usage)),
                Ok(Message::Nothing) => {
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
    fn receive(&mut self, timeout: Duration) -> io::Result<Message> {
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
                    return Ok(Message::Nothing);
                }
                Err(error) => return Err(error),
            }
        }
        let Some((line, rest)) = self.pending.split_once('\n') else { return Ok(Message::Nothing) };
        let (line, rest) = (line.to_owned(), rest.to_owned());
        self.pending = rest;
        Ok(self.parse(&line))
    }

    fn parse(&mut self, line: &str) -> Message {
        let (verb, rest) = line.split_once(' ').unwrap_or((line, ""));
        let mut numbers = rest.split(' ').map(|word| word.parse::<i64>().unwrap_or_default());
        let mut number = || numbers.next().unwrap_or_default();
        let usage = |peak: i64, cpu: i64, resident: i64| Usage {
            peak: u64::try_from(peak).unwrap_or_default(),
            cpu: Duration::from_micros(u64::try_from(cpu).unwrap_or_default()),
            resident: u64::try_from(resident).unwrap_or_default(),
        };
        match verb {
            "started" => {
                self.group = i32::try_from(number()).ok().and_then(Pid::from_raw);
                Message::Nothing
            }
            "exited" => Message::Ended(End::Exited(number() as i32), usage(number(), number(), number())),
            "killed" => Message::Ended(End::Signalled(number() as i32), usage(number(), number(), number())),
            "starved" => Message::Ended(End::Starved, usage(number(), number(), number())),
            "missing" => Message::Ended(End::Missing, Usage::default()),
            "interpreter" => Message::Ended(End::NoInterpreter(rest.to_owned()), Usage::default()),
            _ => Message::Ended(End::Failed(rest.to_owned()), Usage::default()),
        }
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

    /// Reads the result, removes the directory, and releases the supervisor.
    fn collect(mut self, most: u64, reading: &Reading<'_>, wanted: fn(&str) -> Option<u64>) -> Ended {
        let mut ended = Ended::default();
        let stream = |name: &str| reading.text(self.place(), name, most).unwrap_or_default();
        (ended.stdout, ended.stderr) = (stream("stdout"), stream("stderr"));
        ended.files = files(self.place(), reading, wanted);
        self.dismiss();
        if let Some(cut) = reading.over() {
            ended.end = cut;
        }
        ended.supervisor = Some(self);
        ended
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
        self.dismiss();
        let _ = self.process.wait();
    }
}

/// A program given as a relative path, as the caller's folder has it; the run has another.
fn located(program: &OsStr) -> OsString {
    let path = Path::new(program);
    match path.components().count() > 1 {
        true => std::path::absolute(path).map_or_else(|_| program.to_owned(), Into::into),
        false => program.to_owned(),
    }
}

/// A word of a command with the paths of the run's files in it. They are absolute, for the
/// sake of wrappers that change the folder.
fn filled(word: &OsStr, directory: &Path, files: &[(&str, &str)]) -> OsString {
    match word.to_str() {
        Some(text) if text.contains('{') => {
            let path = |file: &str| directory.join(file).to_string_lossy().into_owned();
            files.iter().fold(text.to_owned(), |text, (mark, file)| text.replace(mark, &path(file))).into()
        }
        _ => word.to_owned(),
    }
}

/// A file for a stream; appended to, so that a program that seeks loses nothing.
fn stream(directory: &Path, name: &str) -> io::Result<Stdio> {
    File::options().create(true).append(true).open(directory.join(name)).map(Stdio::from)
}

/// How long there is to read what a program left.
struct Reading<'a> {
    host: &'a Host<'a>,
    /// Whether it goes on after an interruption.
    is_kept: bool,
    deadline: Option<Instant>,
}

impl Reading<'_> {
    /// Why nothing more is to be read.
    fn over(&self) -> Option<End> {
        match self.deadline {
            _ if self.host.is_interrupted() && !self.is_kept => Some(End::Interrupted),
            Some(deadline) if Instant::now() > deadline => Some(End::OutOfTime),
            _ => None,
        }
    }

    /// The first `limit` bytes of a file in the run's directory. What is not a file of its own
    /// there has no text: a pipe, a device, a link that leads out.
    fn text(&self, directory: &Path, name: &str, limit: u64) -> Option<String> {
        let path = directory.join(name).canonicalize().ok()?;
        if !path.starts_with(directory.canonicalize().ok()?) {
            return None;
        }
        // Between a look at a file and its opening, it could become another.
        let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::NOCTTY).bits();
        let file = File::options().read(true).custom_flags(i32::try_from(flags).ok()?).open(path).ok()?;
        if !file.metadata().ok()?.is_file() {
            return None;
        }
        let (mut file, mut bytes) = (file.take(limit), Vec::new());
        while self.over().is_none() && file.by_ref().take(PIECE as u64).read_to_end(&mut bytes).ok()? > 0 {}
        Some(String::from_utf8(bytes).unwrap_or_else(|error| String::from_utf8_lossy(error.as_bytes()).into_owned()))
    }
}

/// The wanted files in the run's directory, in their order.
fn files(directory: &Path, reading: &Reading<'_>, wanted: fn(&str) -> Option<u64>) -> Vec<Source> {
    let Ok(entries) = fs::read_dir(directory) else { return Vec::new() };
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<(u64, String)> = names.filter_map(|name| Some((wanted(&name)?, name))).collect();
    names.sort();
    let texts = names.into_iter().filter_map(|(_, name)| {
        let text = reading.text(directory, &name, LARGEST_FILE)?;
        Some(Source::new(name, text))
    });
    texts.collect()
}

/// Whether a program ended for want of memory: it ended badly, and either says so or
/// was seen close to the limit.
fn starved(end: &End, ended: &Ended, peak: u64, limit: u64) -> bool {
    const COMPLAINTS: [&str; 15] = [
        "out of memory",
        "memory exhausted",
        "no memory",
        "bad_alloc",
        "memoryerror",
        "memory allocation",
        "cannot allocate",
        "can't allocate",
        "out of space",
        "not enough memory",
        "insufficient memory",
        // Messages of the dynamic linker and the thread library.
        "failed to map segment",
        "cannot map zero-fill",
        "cannot create shared object descriptor",
        "resource temporarily unavailable",
    ];
    let badly = match end {
        End::Exited(code) => *code != 0,
        End::Signalled(_) => true,
        _ => end.failure().is_some(),
    };
    let tail = |text: &str| {
        let start = text.len().saturating_sub(4096);
        let start = (start..=text.len()).find(|at| text.is_char_boundary(*at)).unwrap_or(0);
        text.get(start..).unwrap_or_default().to_lowercase()
    };
    let failure = end.failure().map(str::to_lowercase).unwrap_or_default();
    let words = format!("{}\n{}\n{failure}", tail(&ended.stdout), tail(&ended.stderr));
    let complains = COMPLAINTS.iter().any(|complaint| words.contains(complaint));
    let close = matches!(end, End::Signalled(_)) && peak.saturating_mul(1024) >= limit / 10 * 8;
    let small = matches!(end, End::Signalled(_)) && limit < SMALL;
    badly && (complains || close || small)
}
