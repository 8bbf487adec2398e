//! A mongod process: started in the background, recognised by the paths of its data and log, stopped.

use std::fs::{self, File};
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process, kill_process_group};

use super::error::{BackendError, answered, failed};
use crate::formats::quantity::write_duration;
use crate::settings::backend::Backend;
use crate::store::mongodb::admin::{Admin, AdminError};

/// How long a process may take to accept a connection, and to answer one that only looks at it.
pub(super) const ANSWER_TIMEOUT: Duration = Duration::from_secs(3);
/// Timeout for the same where it is to be started or stopped: on a busy machine it answers late.
const BUSY_ANSWER_TIMEOUT: Duration = Duration::from_secs(15);
/// How long a primary looks for another member to take over.
const HANDOVER_TIMEOUT: Duration = Duration::from_secs(3);
/// How long a process that listens may take to go into the background.
const FORK_TIMEOUT: Duration = Duration::from_secs(2);
/// A file in each folder of data that mongod uses.
const OF_MONGOD: &str = "storage.bson";
/// How often it is looked whether it has ended.
const POLL_INTERVAL: Duration = Duration::from_millis(25);

/// A process that runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Running {
    /// Its process id.
    pub pid: Option<i64>,
    /// Whether it was started just now.
    pub started: bool,
    /// Whether `rmem backend up` started it, now or earlier.
    pub ours: bool,
}

/// What became of a process that was to be stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Down {
    /// It ended.
    Stopped(Option<i64>),
    /// It did not run.
    Absent,
    /// Something else started it; it was left alone.
    Foreign(Option<i64>),
}

/// Starts a process that does not run; returns what runs now.
///
/// # Errors
/// Where mongod is missing or does not start, or its port is taken by something else.
pub fn up(backend: &Backend) -> Result<Running, BackendError> {
    let data = folder(backend)?;
    // Two that start it at once do so one after the other.
    let lock = File::open(&data).and_then(|folder| folder.lock().map(|()| folder));
    let _lock = lock.map_err(|error| failed(backend, format!("cannot lock {}: {error}", data.display())))?;
    if let Some(running) = look(backend, &data, BUSY_ANSWER_TIMEOUT)? {
        return Ok(running);
    }
    start(backend, &data)?;
    await_answer(backend);
    match look(backend, &data, BUSY_ANSWER_TIMEOUT)? {
        Some(running) => {
            let pid = running.pid.map(|pid| pid.to_string()).unwrap_or_default();
            // For people, and for a process that does not listen; a listening process is asked itself.
            let _ = fs::write(beside(&data, "pid"), pid + "\n");
            Ok(Running { started: true, ..running })
        }
        None => Err(failed(backend, format!("mongod ended at once; see {}", log_of(backend, &data).display()))),
    }
}

/// The folder of the data, made where it is not there, by its full name.
fn folder(backend: &Backend) -> Result<PathBuf, BackendError> {
    let path = &backend.path;
    fs::create_dir_all(path)
        .and_then(|()| fs::canonicalize(path))
        .map_err(|error| failed(backend, format!("cannot make the folder {}: {error}", path.display())))
}

/// A file beside the folder of the data.
fn beside(data: &Path, extension: &str) -> PathBuf {
    let mut name = data.as_os_str().to_owned();
    name.push(".");
    name.push(extension);
    name.into()
}

/// The log of the process.
fn log_of(backend: &Backend, data: &Path) -> PathBuf {
    backend.log.clone().unwrap_or_else(|| beside(data, "log"))
}

/// The process, where it runs; an error where something else has its port, or it does not answer in time.
pub(super) fn look(backend: &Backend, data: &Path, timeout: Duration) -> Result<Option<Running>, BackendError> {
    let address = backend.address();
    if !is_taken(&address) {
        return Ok(None);
    }
    let admin = Admin::at(&address, timeout).map_err(|error| answered(backend, error))?;
    let started = match admin.started() {
        Ok(started) => started,
        Err(AdminError::Silent(_)) => {
            let reason = match noted(data).filter(|pid| is_mongod_of(*pid, data)) {
                Some(pid) => format!(
                    "its mongod, process {pid}, listens on port {} and does not answer: it is suspended or overloaded; \
                     `kill -CONT {pid}` lets a suspended process go on",
                    backend.port
                ),
                None => format!(
                    "the port {} is taken by something that does not answer as mongod does within {}; give another port",
                    backend.port,
                    write_duration(timeout)
                ),
            };
            return Err(failed(backend, reason));
        }
        Err(AdminError::Refused { .. }) => {
            let reason =
                format!("the port {} is taken by a mongod that wants a login; give another port", backend.port);
            return Err(failed(backend, reason));
        }
    };
    let its = started.data.as_deref().map(|path| fs::canonicalize(path).unwrap_or_else(|_| path.to_owned()));
    if its.as_deref() != Some(data) {
        let its = its.map_or_else(|| "somewhere else".to_owned(), |path| format!("in {}", path.display()));
        let reason = format!(
            "the port {} is taken by another mongod, with its data {its}; give another port or path",
            backend.port
        );
        return Err(failed(backend, reason));
    }
    let set = started.set.as_deref().map(|set| set.split('/').next().unwrap_or_default());
    if set != Some(backend.replica_set.as_str()) {
        let set = set.map_or_else(|| "without a replica set".to_owned(), |set| format!("for the replica set `{set}`"));
        let reason = format!(
            "it runs {set}, not for `{}`; stop it, and start it again with `rmem backend up`",
            backend.replica_set
        );
        return Err(failed(backend, reason));
    }
    let pid = admin.pid().map_err(|error| answered(backend, error))?;
    let ours = started.log.is_some_and(|log| log == log_of(backend, data));
    Ok(Some(Running { pid, started: false, ours }))
}

/// Waits until a process that listens answers: on a busy machine that takes longer than it takes one that has run for a while.
fn await_answer(backend: &Backend) {
    let (address, since) = (backend.address(), Instant::now());
    let is_silent = || {
        let started = Admin::at(&address, ANSWER_TIMEOUT).and_then(|admin| admin.started());
        matches!(started, Err(AdminError::Silent(_)))
    };
    while is_taken(&address) && is_silent() && since.elapsed() < backend.start_timeout {
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// Whether something listens.
fn is_taken(address: &str) -> bool {
    let mut addresses = address.to_socket_addrs().into_iter().flatten();
    addresses.any(|address| TcpStream::connect_timeout(&address, ANSWER_TIMEOUT).is_ok())
}

/// The process id that was noted when the process was started.
fn noted(data: &Path) -> Option<i64> {
    fs::read_to_string(beside(data, "pid")).ok()?.trim().parse().ok()
}

/// Starts mongod, which goes into the background once it listens.
fn start(backend: &Backend, data: &Path) -> Result<(), BackendError> {
    let log = log_of(backend, data);
    let folder = log.parent().map_or(Ok(()), fs::create_dir_all);
    folder.map_err(|error| failed(backend, format!("cannot make the folder of the log {}: {error}", log.display())))?;
    let before = fs::metadata(&log).map_or(0, |found| if backend.log_append { found.len() } else { 0 });
    let mut command = Command::new(&backend.mongod);
    command.arg("--fork").arg("--logpath").arg(&log).arg("--dbpath").arg(data);
    if backend.log_append {
        command.arg("--logappend");
    }
    command.args(["--port", &backend.port.to_string(), "--bind_ip", &backend.bind]);
    command.args(["--replSet", &backend.replica_set]);
    if let Some(bytes) = backend.oplog_size {
        command.args(["--oplogSize", &(bytes >> 20).to_string()]);
    }
    if let Some(bytes) = backend.cache_size {
        #[expect(clippy::cast_precision_loss, reason = "a size in GB need not be exact")]
        command.args(["--wiredTigerCacheSizeGB", &(bytes as f64 / f64::from(1 << 30)).to_string()]);
    }
    command.args(&backend.arguments);
    let unstarted = |error: &io::Error| failed(backend, format!("cannot start {}: {error}", backend.mongod.display()));
    // A file, which is whole when the program has ended; a pipe is, once all that it left in the background has.
    let output = tempfile::tempfile().map_err(|error| unstarted(&error))?;
    let stream = || output.try_clone().map(Stdio::from).map_err(|error| unstarted(&error));
    command.stdin(Stdio::null()).stdout(stream()?).stderr(stream()?).process_group(0);
    let mut child = command.spawn().map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => {
            BackendError::NoProgram { backend: backend.name, program: backend.mongod.display().to_string() }
        }
        _ => unstarted(&error),
    })?;
    let reason = match attend(backend, data, &mut child).map_err(|error| unstarted(&error))? {
        Start::Done => return Ok(()),
        Start::Silent => {
            let _ = kill_process_group(Pid::from_child(&child), Signal::KILL);
            let _ = child.wait();
            let limit = write_duration(backend.start_timeout);
            format!("it neither listened nor wrote to its log for {limit} (start_timeout)")
        }
        Start::Failed(status) => {
            let words = logged_error(&log, before).or_else(|| printed(output));
            words.unwrap_or_else(|| format!("it ended with {status} and printed nothing"))
        }
    };
    let program = backend.mongod.display();
    Err(failed(backend, format!("{program} did not start as a mongod: {reason}; its log is {}", log.display())))
}

/// The result of starting mongod.
enum Start {
    /// It runs in the background.
    Done,
    /// It ended.
    Failed(ExitStatus),
    /// It does nothing.
    Silent,
}

/// Waits until mongod has gone into the background, or stays where it was started and listens.
fn attend(backend: &Backend, data: &Path, child: &mut Child) -> io::Result<Start> {
    let log = log_of(backend, data);
    let (mut length, mut progress) = (0, Instant::now());
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(if status.success() { Start::Done } else { Start::Failed(status) });
        }
        let now = fs::metadata(&log).map_or(0, |found| found.len());
        if now != length {
            (length, progress) = (now, Instant::now());
        }
        if progress.elapsed() > FORK_TIMEOUT
            && look(backend, data, ANSWER_TIMEOUT).is_ok_and(|running| running.is_some())
        {
            // Some cannot go into the background by themselves.
            return Ok(Start::Done);
        }
        if progress.elapsed() > backend.start_timeout {
            return Ok(Start::Silent);
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// What a program that failed printed: the lines that speak of an error, or else the last.
fn printed(mut output: File) -> Option<String> {
    let mut bytes = Vec::new();
    output.rewind().and_then(|()| output.read_to_end(&mut bytes)).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let errors: Vec<&str> = text.lines().filter(|line| line.contains("rror")).collect();
    let last = text.lines().map(str::trim).rfind(|line| !line.is_empty());
    if errors.is_empty() { last.map(str::to_owned) } else { Some(errors.join("; ")) }
}

/// The last error in what was added to a log of mongod.
fn logged_error(log: &Path, from: u64) -> Option<String> {
    let mut added = String::new();
    let mut file = File::open(log).ok()?;
    file.seek(SeekFrom::Start(from)).ok()?;
    file.read_to_string(&mut added).ok()?;
    let mut entries = added.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    let entry = entries.rfind(|entry| matches!(entry["s"].as_str(), Some("E" | "F")))?;
    let cause = &entry["attr"]["error"];
    let cause = cause.as_str().or_else(|| cause["errmsg"].as_str());
    Some(cause.or_else(|| entry["msg"].as_str())?.to_owned())
}

/// Stops a process that [`up`] started, and waits until it has ended.
///
/// # Errors
/// Where it does not end, or something else has its port.
pub fn down(backend: &Backend) -> Result<Down, BackendError> {
    let Ok(data) = fs::canonicalize(&backend.path) else { return Ok(Down::Absent) };
    let Some(running) = look(backend, &data, BUSY_ANSWER_TIMEOUT)? else {
        return match noted(&data).filter(|pid| is_mongod_of(*pid, &data)) {
            // It does not listen yet, or any more.
            Some(pid) => terminate(backend, &data, pid),
            None => {
                let _ = fs::remove_file(beside(&data, "pid"));
                Ok(Down::Absent)
            }
        };
    };
    let Some(pid) = running.pid.filter(|_| running.ours) else { return Ok(Down::Foreign(running.pid)) };
    let asked = Admin::at(&backend.address(), ANSWER_TIMEOUT).and_then(|admin| admin.shut_down(HANDOVER_TIMEOUT));
    match asked {
        Ok(()) => wait(backend, &data, pid),
        Err(_) => terminate(backend, &data, pid),
    }
}

fn terminate(backend: &Backend, data: &Path, pid: i64) -> Result<Down, BackendError> {
    let process = i32::try_from(pid).ok().and_then(Pid::from_raw).filter(|_| is_mongod_of(pid, data));
    if let Some(process) = process {
        kill_process(process, Signal::TERM)
            .map_err(|error| failed(backend, format!("cannot stop the process {pid}: {error}")))?;
    }
    wait(backend, data, pid)
}

fn wait(backend: &Backend, data: &Path, pid: i64) -> Result<Down, BackendError> {
    let since = Instant::now();
    while is_mongod_of(pid, data) {
        if since.elapsed() > backend.stop_timeout {
            let reason = format!("the process {pid} does not end; see {}", log_of(backend, data).display());
            return Err(failed(backend, reason));
        }
        std::thread::sleep(POLL_INTERVAL);
    }
    let _ = fs::remove_file(beside(data, "pid"));
    if backend.clear_on_stop {
        clear(backend, data)?;
    }
    Ok(Down::Stopped(Some(pid)))
}

/// Removes the data of a process that ended. A folder that is not one of mongod is left alone.
fn clear(backend: &Backend, data: &Path) -> Result<(), BackendError> {
    if !data.join(OF_MONGOD).is_file() {
        return Ok(());
    }
    fs::remove_dir_all(data).map_err(|error| failed(backend, format!("cannot remove {}: {error}", data.display())))
}

/// Whether a process is alive and was started with this folder of data.
fn is_mongod_of(pid: i64, data: &Path) -> bool {
    let Ok(line) = fs::read(format!("/proc/{pid}/cmdline")) else { return false };
    let mut words = line.split(|byte| *byte == 0);
    words.any(|word| word == b"--dbpath") && words.next() == Some(data.as_os_str().as_encoded_bytes())
}
