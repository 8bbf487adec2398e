//! The warden: the process between rmem and a planner.
//!
//! rmem starts itself again as `rmem __warden [--memory BYTES] --directory DIR --
//! PROGRAM ARGUMENT…`, with one end of a socket pair as standard input, the
//! *lifeline*. The warden starts the program in a process group of its own under
//! limits, adopts whatever the program leaves behind (it is a subreaper), and says on
//! the lifeline what happens, one line each:
//!
//! | warden says | |
//! |---|---|
//! | `started PID` | the program runs; `PID` is its group |
//! | `exited CODE PEAK` | it ended with an exit code; `PEAK` KiB of address space were seen |
//! | `killed SIGNAL PEAK` | it ended by a signal |
//! | `missing` | there is no such program |
//! | `failed WORDS` | it could not be started |
//!
//! rmem says `stop`, and the group gets TERM, a grace, then KILL; or `done`, when it
//! has read what it wants. An end of the lifeline without `done` means that rmem died:
//! the warden stops the program and removes the directory. When the warden reports
//! the end, nothing that the program started is alive.

use std::ffi::OsString;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::process::{
    Pid, PidfdFlags, Resource, Rlimit, Signal, WaitOptions, getpid, getrlimit, kill_process, kill_process_group,
    pidfd_open, prlimit, set_child_subreaper, setrlimit, wait,
};

/// How long a program has between TERM and KILL.
pub(super) const GRACE: Duration = Duration::from_millis(500);

/// How long the warden tries to bury what is left.
const BURIAL: Duration = Duration::from_secs(3);

/// How often the program's memory is looked at, where it is limited.
const LOOK: Duration = Duration::from_millis(20);

/// The hidden command that makes a process of rmem a warden.
pub const COMMAND: &str = "__warden";

/// Runs the warden; the arguments are those after `__warden`. Returns the exit code of
/// the process, which says nothing: what happened goes over the lifeline.
#[must_use]
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> i32 {
    let Some(order) = Order::read(arguments.into_iter()) else { return 2 };
    let Ok(lifeline) = io::stdin().as_fd().try_clone_to_owned() else { return 2 };
    let mut lifeline = Lifeline { stream: UnixStream::from(lifeline), pending: String::new(), lost: false };
    let said = match order.start() {
        Ok(child) => Ward { child, limited: order.memory.is_some(), peak: 0 }.watch(&mut lifeline),
        Err(error) if error.kind() == io::ErrorKind::NotFound => "missing".to_owned(),
        Err(error) => format!("failed {error}"),
    };
    lifeline.say(&said);
    if !lifeline.released() {
        let _ = fs::remove_dir_all(&order.directory);
    }
    0
}

/// What the warden is told to do.
struct Order {
    directory: PathBuf,
    memory: Option<u64>,
    program: OsString,
    arguments: Vec<OsString>,
}

impl Order {
    fn read(mut arguments: impl Iterator<Item = OsString>) -> Option<Self> {
        let (mut directory, mut memory) = (None, None);
        loop {
            match arguments.next()?.to_str()? {
                "--directory" => directory = Some(PathBuf::from(arguments.next()?)),
                "--memory" => memory = Some(arguments.next()?.to_str()?.parse().ok()?),
                "--" => break,
                _ => return None,
            }
        }
        Some(Self { directory: directory?, memory, program: arguments.next()?, arguments: arguments.collect() })
    }

    fn start(&self) -> io::Result<Child> {
        set_child_subreaper(Some(getpid()))?;
        setrlimit(Resource::Core, Rlimit { current: Some(0), maximum: Some(0) })?;
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).current_dir(&self.directory).stdin(Stdio::null()).process_group(0);
        let Some(bytes) = self.memory else { return command.spawn() };
        // The program inherits the soft limit, so that it never runs without; then it
        // gets the hard one, and the warden its own limit back.
        let own = getrlimit(Resource::As);
        let lowered = setrlimit(Resource::As, Rlimit { current: Some(bytes), maximum: own.maximum });
        let started = command.spawn();
        if lowered.is_ok() {
            setrlimit(Resource::As, own)?;
        }
        let child = match started {
            // The warden itself is larger than the limit.
            Err(error) if error.kind() == io::ErrorKind::OutOfMemory => command.spawn()?,
            started => started?,
        };
        let limit = Rlimit { current: Some(bytes), maximum: Some(bytes) };
        let _ = prlimit(Some(Pid::from_child(&child)), Resource::As, limit);
        Ok(child)
    }
}

/// The socket to rmem.
struct Lifeline {
    stream: UnixStream,
    pending: String,
    /// rmem is gone.
    lost: bool,
}

impl Lifeline {
    fn say(&mut self, words: &str) {
        if self.stream.write_all(format!("{words}\n").as_bytes()).is_err() {
            self.lost = true;
        }
    }

    /// The next word of rmem's, waiting for it; none when rmem is gone.
    fn hear(&mut self) -> Option<String> {
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

    /// Waits until rmem says something, the program ends, or patience does; true where rmem
    /// says something. Without `listening` it may say what it likes.
    fn called(&self, program: Option<&OwnedFd>, patience: Option<Duration>, listening: bool) -> io::Result<bool> {
        let mut waits = Vec::with_capacity(2);
        waits.extend(program.map(|program| PollFd::new(program, PollFlags::IN)));
        if listening {
            waits.push(PollFd::new(&self.stream, PollFlags::IN));
        }
        // Without pidfds (old kernels) the program's end has to be looked for.
        let patience = match program {
            Some(_) => patience,
            None => Some(patience.unwrap_or(LOOK).min(Duration::from_millis(2))),
        };
        match poll(&mut waits, patience.and_then(|patience| Timespec::try_from(patience).ok()).as_ref()) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        Ok(listening && waits.last().is_some_and(|lifeline| !lifeline.revents().is_empty()))
    }

    /// Waits until rmem needs nothing more; false when it died.
    fn released(&mut self) -> bool {
        while let Some(word) = self.hear() {
            if word == "done" {
                return true;
            }
        }
        false
    }
}

/// The program under watch.
struct Ward {
    child: Child,
    limited: bool,
    peak: u64,
}

impl Ward {
    /// Watches the program to its end and buries what it leaves; says how it ended.
    fn watch(mut self, lifeline: &mut Lifeline) -> String {
        let group = Pid::from_child(&self.child);
        lifeline.say(&format!("started {}", group.as_raw_nonzero()));
        let status = self.outlive(group, lifeline);
        let _ = kill_process_group(group, Signal::KILL);
        bury();
        match status.as_ref().map(|status| (status.code(), status.signal())) {
            Ok((Some(code), _)) => format!("exited {code} {}", self.peak),
            Ok((None, signal)) => format!("killed {} {}", signal.unwrap_or_default(), self.peak),
            Err(error) => format!("failed {error}"),
        }
    }

    /// Waits for the program, and stops it when rmem says so or is gone.
    fn outlive(&mut self, group: Pid, lifeline: &mut Lifeline) -> io::Result<ExitStatus> {
        let pidfd = pidfd_open(group, PidfdFlags::empty()).ok();
        let mut deadline: Option<Instant> = None;
        loop {
            if let Some(status) = self.child.try_wait()? {
                return Ok(status);
            }
            let called = lifeline.called(pidfd.as_ref(), self.patience(deadline), deadline.is_none())?;
            if called && lifeline.hear().is_none_or(|word| word == "stop") {
                let _ = kill_process_group(group, Signal::TERM);
                deadline = Some(Instant::now() + GRACE);
            }
            if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                let _ = kill_process_group(group, Signal::KILL);
                return self.child.wait();
            }
            if self.limited {
                self.look(group);
            }
        }
    }

    /// How long to wait before looking again.
    fn patience(&self, deadline: Option<Instant>) -> Option<Duration> {
        match deadline {
            Some(deadline) => Some(deadline.saturating_duration_since(Instant::now())),
            None => self.limited.then_some(LOOK),
        }
    }

    /// Notes how much address space the program has had at most.
    fn look(&mut self, pid: Pid) {
        let status = fs::read_to_string(format!("/proc/{}/status", pid.as_raw_nonzero())).unwrap_or_default();
        let peak = status.lines().find_map(|line| line.strip_prefix("VmPeak:"));
        let peak = peak.and_then(|peak| peak.split_whitespace().next()?.parse().ok());
        self.peak = self.peak.max(peak.unwrap_or_default());
    }
}

/// Kills and reaps every child until there is none. What a child leaves behind when it
/// dies becomes the warden's child in turn.
fn bury() {
    let deadline = Instant::now() + BURIAL;
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

    fn order(words: &[&str]) -> Option<Order> {
        Order::read(words.iter().map(OsString::from))
    }

    #[test]
    fn an_order_names_directory_and_program() {
        let order = order(&["--memory", "1000", "--directory", "/d", "--", "ff", "--memory"]).unwrap();
        assert_eq!((order.memory, order.program.to_str(), order.arguments.len()), (Some(1000), Some("ff"), 1));
    }

    #[test]
    fn what_is_no_order_is_refused() {
        for words in [&[][..], &["--"], &["--directory", "/d", "--"], &["--memory", "x", "--directory", "/", "--", "a"]]
        {
            assert!(order(words).is_none(), "{words:?}");
        }
    }

    #[test]
    fn processes_know_their_parent() {
        let own = i32::try_from(std::process::id()).unwrap();
        assert!(parent(own).is_some());
        assert_eq!(parent(0), None);
    }
}
