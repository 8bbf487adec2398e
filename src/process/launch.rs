//! The process that becomes the program.
//!
//! The supervisor starts it as a process of its own. It looks for the program in `PATH` of its
//! environment and replaces itself with it. If the program is rmem itself, it continues in place.

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

use rustix::process::{Resource, Rlimit, Signal, getpid, getppid, set_parent_process_death_signal, setrlimit};
use rustix::stdio::dup2_stdin;

use super::{search, usage};

/// What the stack of the first thread may come to need, in bytes.
const STACK: u64 = 8 << 20;

/// How a process continues that was started as a supervisor.
#[derive(Debug)]
#[must_use]
pub enum Next {
    /// It exits. The code has no meaning: the result was sent over the lifeline.
    Exit(i32),
    /// It continues as the program, which is rmem, with this command line; limits and streams are set.
    Rmem(Vec<OsString>),
}

/// The message of the supervisor that the program may run.
pub(super) const GO: &[u8] = b"g";

/// Becomes the program. Returns where that is rmem itself, at `own`, and where it fails, which it reports on
/// standard input. The arguments are `--parent PID [--memory BYTES] [--input FILE] -- PROGRAM ARGUMENT…`.
pub(super) fn run(arguments: impl Iterator<Item = OsString>, own: &Path) -> Next {
    let Ok(supervisor) = io::stdin().as_fd().try_clone_to_owned() else { return Next::Exit(2) };
    let mut supervisor = UnixStream::from(supervisor);
    match become_program(arguments, &mut supervisor, own) {
        Ok(words) => Next::Rmem(words),
        Err(words) => {
            let _ = supervisor.write_all(words.as_bytes());
            Next::Exit(2)
        }
    }
}

fn become_program(
    mut arguments: impl Iterator<Item = OsString>,
    supervisor: &mut UnixStream,
    own: &Path,
) -> Result<Vec<OsString>, String> {
    let (mut parent, mut memory, mut input) = (None, None, None);
    let number = |arguments: &mut dyn Iterator<Item = OsString>| arguments.next()?.to_str()?.parse::<u64>().ok();
    loop {
        match arguments.next().as_deref().and_then(OsStr::to_str) {
            Some("--parent") => parent = number(&mut arguments),
            Some("--memory") => memory = number(&mut arguments),
            Some("--input") => input = arguments.next(),
            Some("--") => break,
            _ => return Err("failed to parse its arguments".to_owned()),
        }
    }
    let failed = |error: &dyn std::fmt::Display| format!("failed {error}");
    set_parent_process_death_signal(Some(Signal::KILL)).map_err(|error| failed(&error))?;
    let is_parent = getppid().is_some_and(|own| u64::try_from(own.as_raw_nonzero().get()).ok() == parent);
    if !is_parent || supervisor.read_exact(&mut [0; GO.len()]).is_err() {
        return Err("failed because its supervisor is gone".to_owned());
    }
    let program = arguments.next().unwrap_or_default();
    let stdin = input.unwrap_or_else(|| "/dev/null".into());
    let stdin = OwnedFd::from(File::open(stdin).map_err(|error| failed(&error))?);
    let is_rmem = Path::new(&program) == own;
    // A process that is above the limit already could not grow its stack.
    if is_rmem && memory.is_some_and(|limit| usage::size(getpid()) * 1024 + STACK > limit) {
        return Err("starved".to_owned());
    }
    if let Some(bytes) = memory {
        let limit = Rlimit { current: Some(bytes), maximum: Some(bytes) };
        setrlimit(Resource::As, limit).map_err(|error| failed(&error))?;
    }
    if is_rmem {
        dup2_stdin(&stdin).map_err(|error| failed(&error))?;
        return Ok(std::iter::once(program).chain(arguments).collect());
    }
    let error = Command::new(&program).args(arguments).stdin(Stdio::from(stdin)).exec();
    Err(match error.kind() {
        io::ErrorKind::NotFound => match interpreter(&program) {
            Some(interpreter) => format!("interpreter {interpreter}"),
            None => "missing".to_owned(),
        },
        // A folder of PATH that may not be read hides no program that is in another one.
        io::ErrorKind::PermissionDenied if is_nowhere(&program) => "missing".to_owned(),
        io::ErrorKind::OutOfMemory | io::ErrorKind::ArgumentListTooLong if memory.is_some() => "starved".to_owned(),
        _ => failed(&error),
    })
}

/// Whether a program is named, not given by its path, and in no folder of `PATH` that may be read, not even as a file
/// that may not be executed.
fn is_nowhere(program: &OsStr) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let is_there = || std::env::split_paths(&path).any(|folder| folder.join(program).is_file());
    Path::new(program).components().count() == 1 && !is_there()
}

/// The interpreter of a script that is there.
fn interpreter(program: &OsStr) -> Option<String> {
    let mut bytes = Vec::new();
    File::open(search::find(program, std::env::var_os("PATH").as_deref())?)
        .ok()?
        .take(256)
        .read_to_end(&mut bytes)
        .ok()?;
    let line = bytes.strip_prefix(b"#!").and_then(|rest| rest.split(|byte| *byte == b'\n').next());
    let line = String::from_utf8_lossy(line.unwrap_or(b"of its executable format")).into_owned();
    Some(line.trim().to_owned())
}
