//! The supervisor: the process between rmem and a program.
//!
//! rmem starts itself again as `rmem __supervisor [--memory BYTES] [--input FILE] [--folder DIR]
//! [--attached] --directory DIR -- PROGRAM ARGUMENT…`, with one end of a socket pair as standard input,
//! the *lifeline*. The supervisor starts the program in a process group of its own under
//! limits, adopts all processes that the program leaves behind (it is a subreaper), and
//! reports on the lifeline what happens, one line each:
//!
//! | report | |
//! |---|---|
//! | `started PID` | the program is there, and waits for rmem's `go`; `PID` is its group |
//! | `exited CODE PEAK CPU RESIDENT` | it ended with an exit code; `PEAK` KiB of address space were seen, `CPU` µs of processors, `RESIDENT` KiB of memory |
//! | `killed SIGNAL PEAK CPU RESIDENT` | it ended by a signal |
//! | `starved PEAK CPU RESIDENT` | its processes together were over the limit of memory, and were ended |
//! | `missing` | there is no such program |
//! | `interpreter PATH` | the program is a script, and its interpreter is not there |
//! | `failed WORDS` | it could not be started |
//!
//! On rmem's message `go` the program runs; its input may be written until then. On any other message, or when rmem
//! has ended, the program does not run, and the supervisor removes the directory and ends without a report. `stop` ends
//! a running program (its group gets TERM, a grace, then KILL), `starve` as well (KILL at once, because several runs
//! together are over a limit of memory); `done` means that rmem has read what it needs. An end of the lifeline without
//! `done` means that rmem has ended: the supervisor stops the program and removes the directory. When the supervisor reports
//! the end, nothing that the program started is alive; but an *attached* program, one that
//! the user gave, may leave something in the background when it ends by itself.
//!
//! The program is started through rmem once more, as `rmem __supervisor --exec …`: that
//! process asks to be killed with the supervisor, sets its limits, and becomes the program; if
//! the program is rmem, by continuing ([`Next::Rmem`]). So the program never runs without its
//! limits, and is killed with the supervisor; rmem then kills the rest of its group. A process
//! that has left the group as well (with `setsid`) survives a killed supervisor.
//!
//! The limit of memory is kept twice: no process gets more address space, and the supervisor
//! adds up what all of them have resident.

use std::ffi::OsString;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::process::{
    Pid, PidfdFlags, Resource, Rlimit, Signal, WaitOptions, getpid, kill_process, kill_process_group, pidfd_open,
    set_child_subreaper, setrlimit, wait,
};

pub use super::launch::Next;
use super::{launch, usage};

/// How long a program has between TERM and KILL.
pub(super) const GRACE: Duration = Duration::from_millis(500);

/// The same for a program that the user gave, which may have a robot to stop.
const LONG_GRACE: Duration = Duration::from_secs(2);

/// How long the supervisor tries to reap the remaining processes.
const REAP_TIMEOUT: Duration = Duration::from_secs(3);

/// How often the memory of the program's processes is measured, where it is limited: often enough that they cannot fill the
/// machine in between.
const POLL_INTERVAL: Duration = Duration::from_millis(25);

/// What makes a supervisor's child of rmem the program.
const EXEC: &str = "--exec";

/// The hidden command that makes a process of rmem a supervisor.
pub const COMMAND: &str = "__supervisor";

/// Runs the supervisor; the arguments are those after `__supervisor`, and `own` is where rmem itself is.
pub fn run(arguments: impl IntoIterator<Item = OsString>, own: &Path) -> Next {
    let mut arguments = arguments.into_iter().peekable();
    if arguments.next_if(|word| word == EXEC).is_some() {
        return launch::run(arguments, own);
    }
    Next::Exit(guard(arguments))
}

fn guard(arguments: impl Iterator<Item = OsString>) -> i32 {
    let Some(instructions) = Instructions::read(arguments) else { return 2 };
    let Ok(lifeline) = io::stdin().as_fd().try_clone_to_owned() else { return 2 };
    let mut lifeline = Lifeline { stream: UnixStream::from(lifeline), pending: String::new(), lost: false };
    let report = match instructions.start(&mut lifeline) {
        Ok(Started::Running(child)) => {
            let supervised = Supervised {
                child,
                attached: instructions.attached,
                stopped: false,
                limit: instructions.memory,
                peak: 0,
                resident: 0,
            };
            supervised.watch(&mut lifeline)
        }
        Ok(Started::Refused(words)) => words,
        Ok(Started::Forgone) => {
            let _ = fs::remove_dir_all(&instructions.directory);
            return 0;
        }
        Err(error) => format!("failed {error}"),
    };
    lifeline.send(&report);
    if !lifeline.released() {
        let _ = fs::remove_dir_all(&instructions.directory);
    }
    0
}

/// The arguments of the supervisor.
struct Instructions {
    /// The run's directory, removed when rmem is gone.
    directory: PathBuf,
    memory: Option<u64>,
    /// What the program reads.
    input: Option<OsString>,
    /// Where it runs; else in the directory.
    folder: Option<PathBuf>,
    /// Whether it is a program that the user gave.
    attached: bool,
    program: OsString,
    arguments: Vec<OsString>,
}

impl Instructions {
    fn read(mut arguments: impl Iterator<Item = OsString>) -> Option<Self> {
        let (mut directory, mut memory, mut input, mut folder) = (None, None, None, None);
        let mut attached = false;
        loop {
            match arguments.next()?.to_str()? {
                "--attached" => attached = true,
                "--directory" => directory = Some(PathBuf::from(arguments.next()?)),
                "--memory" => memory = Some(arguments.next()?.to_str()?.parse().ok()?),
                "--input" => input = Some(arguments.next()?),
                "--folder" => folder = Some(PathBuf::from(arguments.next()?)),
                "--" => break,
                _ => return None,
            }
        }
        let (directory, program) = (directory?, arguments.next()?);
        Some(Self { directory, memory, input, folder, attached, program, arguments: arguments.collect() })
    }

    fn start(&self, lifeline: &mut Lifeline) -> io::Result<Started> {
        set_child_subreaper(Some(getpid()))?;
        setrlimit(Resource::Core, Rlimit { current: Some(0), maximum: Some(0) })?;
        let (mut ours, theirs) = UnixStream::pair()?;
        let mut command = Command::new("/proc/self/exe");
        command.args([COMMAND, EXEC, "--parent", &getpid().to_string()]);
        if let Some(bytes) = self.memory {
            command.args(["--memory", &bytes.to_string()]);
        }
        if let Some(file) = &self.input {
            command.arg("--input").arg(file);
        }
        command.arg("--").arg(&self.program).args(&self.arguments);
        command
            .current_dir(self.folder.as_ref().unwrap_or(&self.directory))
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .process_group(0);
        let mut child = command.spawn()?;
        drop(command);
        // The program does not run before rmem can know its group, whatever becomes of the supervisor.
        lifeline.send(&format!("started {}", Pid::from_child(&child).as_raw_nonzero()));
        if lifeline.receive().as_deref() != Some("go") {
            let _ = child.kill().and_then(|()| child.wait());
            return Ok(Started::Forgone);
        }
        let _ = ours.write_all(launch::GO);
        // No message means that exec succeeded.
        let mut words = String::new();
        let received = ours.read_to_string(&mut words);
        if words.is_empty() && received.is_ok() {
            return Ok(Started::Running(child));
        }
        let _ = child.kill();
        child.wait()?;
        received?;
        Ok(Started::Refused(words))
    }
}

/// The result of starting the program.
enum Started {
    Running(Child),
    /// The program is not wanted any more, or rmem is gone.
    Forgone,
    /// It could not be started; the report.
    Refused(String),
}

/// The socket to rmem.
struct Lifeline {
    stream: UnixStream,
    pending: String,
    /// rmem is gone.
    lost: bool,
}

impl Lifeline {
    fn send(&mut self, words: &str) {
        if self.stream.write_all(format!("{words}\n").as_bytes()).is_err() {
            self.lost = true;
        }
    }

    /// Waits for the next message of rmem; none when rmem has ended.
    fn receive(&mut self) -> Option<String> {
        loop {
            if let Some((word, rest)) = self.pending.split_once('\n') {
                let word = word.to_owned();
                self.pending = rest.to_owned();
                return Some(word);
            }
            let mut buffer = [0; 64];
            match self.stream.read(&mut buffer) {
                Ok(0) => break,
                Ok(read) => self.pending.push_str(&String::from_utf8_lossy(buffer.get(..read)?)),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => break,
            }
        }
        self.lost = true;
        None
    }

    /// Waits until rmem sends a message, the program ends, or the timeout is over; returns whether
    /// there is a message. Without `is_open`, messages are ignored.
    fn has_message(&self, program: Option<&OwnedFd>, timeout: Option<Duration>, is_open: bool) -> io::Result<bool> {
        let mut waits = Vec::with_capacity(2);
        waits.extend(program.map(|program| PollFd::new(program, PollFlags::IN)));
        if is_open {
            waits.push(PollFd::new(&self.stream, PollFlags::IN));
        }
        // Without pidfds (old kernels) the program's end has to be looked for.
        let timeout = match program {
            Some(_) => timeout,
            None => Some(timeout.unwrap_or(POLL_INTERVAL).min(Duration::from_millis(2))),
        };
        match poll(&mut waits, timeout.and_then(|timeout| Timespec::try_from(timeout).ok()).as_ref()) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        Ok(is_open && waits.last().is_some_and(|lifeline| !lifeline.revents().is_empty()))
    }

    /// Waits until rmem needs nothing more; returns false when it has ended.
    fn released(&mut self) -> bool {
        while let Some(word) = self.receive() {
            if word == "done" {
                return true;
            }
        }
        false
    }
}

/// The supervised program.
struct Supervised {
    child: Child,
    /// Whether what it leaves in the background may live.
    attached: bool,
    /// Whether it was stopped.
    stopped: bool,
    /// The limit of memory, in bytes.
    limit: Option<u64>,
    peak: u64,
    /// The most that its processes had resident, in KiB.
    resident: u64,
}

/// How a supervised program ended.
enum Watched {
    Ended(ExitStatus),
    /// With more memory than it may have.
    Starved,
}

impl Supervised {
    /// Waits for the end of the program and reaps what it leaves; returns the report.
    fn watch(mut self, lifeline: &mut Lifeline) -> String {
        let group = Pid::from_child(&self.child);
        let status = self.wait_for_end(group, lifeline);
        if !self.attached || self.stopped || !matches!(status, Ok(Watched::Ended(_))) {
            let _ = kill_process_group(group, Signal::KILL);
            reap();
        }
        let (cpu, most) = usage::ended();
        // Before it became the program, its process was rmem: a figure like that of rmem itself says nothing where there is a better one.
        let is_its_own = self.resident == 0 || most > usage::most(getpid());
        let resident = if is_its_own { self.resident.max(most) } else { self.resident };
        let used = format!("{} {} {resident}", self.peak, cpu.as_micros());
        match status {
            Ok(Watched::Ended(status)) => match status.code() {
                Some(code) => format!("exited {code} {used}"),
                None => format!("killed {} {used}", status.signal().unwrap_or_default()),
            },
            Ok(Watched::Starved) => format!("starved {used}"),
            Err(error) => format!("failed {error}"),
        }
    }

    /// Waits for the program, and stops it on a message or when rmem has ended.
    fn wait_for_end(&mut self, group: Pid, lifeline: &mut Lifeline) -> io::Result<Watched> {
        let pidfd = pidfd_open(group, PidfdFlags::empty()).ok();
        let mut deadline: Option<Instant> = None;
        loop {
            if let Some(status) = self.child.try_wait()? {
                return Ok(Watched::Ended(status));
            }
            let has_message = lifeline.has_message(pidfd.as_ref(), self.timeout(deadline), deadline.is_none())?;
            if has_message {
                match lifeline.receive().as_deref() {
                    None | Some("stop") => {
                        let _ = kill_process_group(group, Signal::TERM);
                        self.stopped = true;
                        deadline = Some(Instant::now() + if self.attached { LONG_GRACE } else { GRACE });
                    }
                    Some("starve") => return self.starve(group),
                    Some(_) => {}
                }
            }
            if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                let _ = kill_process_group(group, Signal::KILL);
                return self.child.wait().map(Watched::Ended);
            }
            if self.limit.is_some_and(|limit| self.is_over(limit, group)) {
                return self.starve(group);
            }
        }
    }

    /// Ends a program that is over a limit of memory: it would run over it during a grace as well.
    fn starve(&mut self, group: Pid) -> io::Result<Watched> {
        let _ = kill_process_group(group, Signal::KILL);
        self.child.wait()?;
        Ok(Watched::Starved)
    }

    /// How long to wait before looking again.
    fn timeout(&self, deadline: Option<Instant>) -> Option<Duration> {
        match deadline {
            Some(deadline) => Some(deadline.saturating_duration_since(Instant::now())),
            None => self.limit.map(|_| POLL_INTERVAL),
        }
    }

    /// Notes how much address space the program has had at most; returns whether all of its
    /// processes together have more than `limit` bytes resident.
    fn is_over(&mut self, limit: u64, program: Pid) -> bool {
        self.peak = self.peak.max(usage::peak(program));
        // What loses its parent becomes the supervisor's child.
        let resident = usage::resident(getpid(), Some(program), limit);
        self.resident = self.resident.max(resident >> 10);
        resident > limit
    }
}

/// Kills and reaps every child until there is none. What a child leaves behind when it
/// dies becomes the supervisor's child in turn.
fn reap() {
    let deadline = Instant::now() + REAP_TIMEOUT;
    let mut pause = Duration::from_micros(100);
    while Instant::now() < deadline {
        match wait(WaitOptions::NOHANG) {
            Ok(Some(_)) | Err(Errno::INTR) => {}
            Ok(None) => {
                for child in children() {
                    let _ = kill_process(child, Signal::KILL);
                }
                std::thread::sleep(pause);
                pause = (pause * 2).min(Duration::from_millis(5));
            }
            Err(_) => return,
        }
    }
}

/// The living children of this process.
fn children() -> Vec<Pid> {
    let own = getpid();
    let Ok(processes) = fs::read_dir("/proc") else { return Vec::new() };
    let names = processes.flatten().filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
    names.filter(|pid| parent(*pid) == Some(own)).filter_map(Pid::from_raw).collect()
}

/// The parent of a process: the fourth field of its `stat`, two after the name in brackets.
fn parent(pid: i32) -> Option<Pid> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let (_, fields) = stat.rsplit_once(") ")?;
    Pid::from_raw(fields.split(' ').nth(1)?.parse().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instructions(words: &[&str]) -> Option<Instructions> {
        Instructions::read(words.iter().map(OsString::from))
    }

    #[test]
    fn arguments_name_directory_and_program() {
        let instructions = instructions(&["--memory", "1000", "--directory", "/d", "--", "ff", "--memory"]).unwrap();
        assert_eq!(
            (instructions.memory, instructions.program.to_str(), instructions.arguments.len()),
            (Some(1000), Some("ff"), 1)
        );
    }

    #[test]
    fn incomplete_arguments_are_refused() {
        for words in [&[][..], &["--"], &["--directory", "/d", "--"], &["--memory", "x", "--directory", "/", "--", "a"]]
        {
            assert!(instructions(words).is_none(), "{words:?}");
        }
    }

    #[test]
    fn processes_know_their_parent() {
        let own = i32::try_from(std::process::id()).unwrap();
        assert!(parent(own).is_some());
        assert_eq!(parent(0), None);
    }
}
