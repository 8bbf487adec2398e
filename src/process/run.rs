//! A run of a program under limits: from its start to what it left.

use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

use super::end::End;
use super::handle::{Left, Supervisor};
use super::host::{Host, Limits};
use super::job::Job;
use super::out_of_memory::ran_out_of_memory;
use super::pool::Share;
use super::reading::{PIECE, Reading};
use crate::formats::Source;

/// How long reading the result may take when the time of the run is over.
const COLLECT_TIMEOUT: Duration = Duration::from_secs(2);

/// How much of the output of a program that printed too much is read, in bytes.
const SAMPLE: u64 = 64 << 10;

/// A program that has ended.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) end: End,
    pub(crate) stdout: String,
    /// How many bytes of its standard output lie before what is not UTF-8, and stands there as a mark; none where all is.
    pub(crate) garbled: Option<usize>,
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
    /// It ended badly, and the disk of its directory is full.
    pub(crate) is_disk_full: bool,
    /// It is ending already, and is waited for on drop.
    _supervisor: Option<Supervisor>,
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
            garbled: None,
            stderr: String::new(),
            files: Vec::new(),
            wall: Duration::ZERO,
            cpu: None,
            resident: None,
            out_of_memory: false,
            is_disk_full: false,
            _supervisor: None,
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
    /// When it began to run, where it did already.
    begun: Option<Instant>,
}

impl Prepared {
    pub(crate) fn new(job: &Job<'_>, limits: &Limits, host: &Host<'_>) -> Self {
        let supervisor = Supervisor::start(job, limits, host);
        Self { supervisor, limits: *limits, wanted: job.wanted, is_kept: false, begun: None }
    }

    /// Lets it run already, with texts that are kept. Where it is dropped before its result is wanted, it is killed.
    pub(crate) fn begin(&mut self, texts: &[(&str, &str)], host: &Host<'_>) {
        let Ok(supervisor) = &mut self.supervisor else { return };
        match feed(supervisor, texts, host) {
            Ok(()) if host.is_interrupted() => {}
            Ok(()) => {
                self.begun = Some(Instant::now());
                supervisor.release();
            }
            Err(end) => self.supervisor = Err(end),
        }
    }

    /// The same program, whose result is read also where an interruption ends it.
    pub(crate) fn kept(self) -> Self {
        Self { is_kept: true, ..self }
    }

    /// Returns whether it runs already.
    pub(crate) fn has_begun(&self) -> bool {
        self.begun.is_some()
    }

    /// Runs it to its end or its limits; the time counts from here, or from where it began, with the texts that it had then.
    /// `share` is its part in a limit of memory that several runs share. When this returns, neither its processes nor its
    /// directory are left; only the supervisor may still be on its way out, until what has [`Ended`] is dropped.
    pub(crate) fn run(self, texts: &[(&str, &str)], share: Option<Share<'_>>, host: &Host<'_>) -> Ended {
        self.attempt(texts, share, host).unwrap_or_else(|end| Ended { end, ..Ended::default() })
    }

    fn attempt(self, texts: &[(&str, &str)], share: Option<Share<'_>>, host: &Host<'_>) -> Result<Ended, End> {
        let (mut supervisor, limits) = (self.supervisor?, self.limits);
        let started = match self.begun {
            Some(begun) => begun,
            None => {
                feed(&supervisor, texts, host)?;
                if host.is_interrupted() {
                    return Ok(Ended { end: End::Interrupted, ..Ended::default() });
                }
                let started = Instant::now();
                supervisor.release();
                started
            }
        };
        let (end, usage) = supervisor.wait(&limits, host, started, share);
        if let Some(share) = share {
            share.release();
        }
        let is_bad = matches!(end, End::Exited(1..) | End::Signalled(_));
        let is_disk_full = is_bad && is_full(supervisor.place());
        let rest = limits.time.map(|time| time.saturating_sub(started.elapsed()).max(COLLECT_TIMEOUT));
        let is_kept = self.is_kept && end == End::Interrupted;
        let rest = if is_kept { Some(COLLECT_TIMEOUT) } else { rest };
        let reading = Reading { host, is_kept, deadline: rest.map(|rest| Instant::now() + rest) };
        let most = if end == End::TooMuchOutput { SAMPLE } else { limits.output };
        let Left { stdout, stderr, files, cut } = supervisor.collect(most, &reading, self.wanted);
        let peak = usage.map_or(0, |usage| usage.peak);
        let ran_out_of_memory = |limit| ran_out_of_memory(&end, [&stdout.text, &stderr.text], peak, limit);
        Ok(Ended {
            wall: started.elapsed(),
            cpu: usage.map(|usage| usage.cpu),
            resident: usage.map(|usage| usage.resident << 10).filter(|bytes| *bytes > 0),
            out_of_memory: end == End::Starved || limits.memory.is_some_and(ran_out_of_memory),
            is_disk_full,
            // Reading that was cut off has its own end; otherwise the program's end counts.
            end: cut.unwrap_or(end),
            stdout: stdout.text,
            garbled: stdout.garbled,
            stderr: stderr.text,
            files,
            _supervisor: Some(supervisor),
        })
    }
}

/// Whether nothing more can be written in a directory.
fn is_full(directory: &Path) -> bool {
    rustix::fs::statvfs(directory).is_ok_and(|disk| disk.f_blocks > 0 && disk.f_bavail == 0)
}

/// Writes the files that the program reads.
fn feed(supervisor: &Supervisor, texts: &[(&str, &str)], host: &Host<'_>) -> Result<(), End> {
    let mut texts = texts.iter();
    let written = texts.try_for_each(|(name, text)| write(&supervisor.place().join(name), text, host));
    written.map_err(|error| End::no_files(host, &error))
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
