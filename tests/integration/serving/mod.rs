//! `rmem serve`: MongoDB clients on the memory.

mod arguments;
mod changed_indexes;
mod clients;
mod elections;
pub(crate) mod executive;
mod failures;
mod front;
mod front_streams;
mod keys;
mod kills;
mod login;
mod messages;
mod operations;
mod outages;
mod process;
mod retries;
mod snapshots;
mod streams;
mod suites;
mod transactions;
mod validators;
mod wire;

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::{Duration, Instant};

use libtest_mimic::{Failed, Trial};
use mongodb::sync::Client;

pub(crate) use elections::KILLERS;
pub(crate) use failures::full_disk;
pub(crate) use front::CASES as IN_FRONT;
pub(crate) use front_streams::{CASES as STREAMS_IN_FRONT, KILLERS as STREAM_KILLERS};
pub(crate) use outages::KILLERS as OUTAGES;
pub(crate) use suites::stop;

/// How long what has to come may take.
const TIMEOUT: Duration = Duration::from_secs(120);

type Case = fn() -> Result<(), Failed>;

/// What is compared with the answers of the server at a URI.
type Beside = fn(&str) -> Result<(), Failed>;

/// All of that.
pub(crate) const BESIDE: [&[(&str, Beside)]; 6] =
    [arguments::BESIDE, changed_indexes::BESIDE, failures::BESIDE, keys::BESIDE, retries::BESIDE, validators::BESIDE];

/// All of them; none needs another program.
pub(crate) fn trials() -> Vec<Trial> {
    let cases =
        [clients::CASES, failures::CASES, kills::CASES, login::CASES, messages::CASES, process::CASES, streams::CASES];
    let cases = cases
        .into_iter()
        .chain([
            changed_indexes::CASES,
            keys::CASES,
            operations::CASES,
            retries::CASES,
            snapshots::CASES,
            transactions::CASES,
            validators::CASES,
        ])
        .flatten();
    let mut trials: Vec<Trial> = cases.map(|(name, case)| Trial::test(format!("serving::{name}"), case)).collect();
    trials.extend(suites::trials());
    trials
}

/// A running `rmem serve`.
pub(crate) struct Served {
    child: Child,
    /// How to reach it.
    pub(crate) uri: String,
}

impl Served {
    /// Serves the file `robot.rmem` of a folder on a free port.
    pub(crate) fn start(folder: &Path, options: &[&str]) -> Result<Self, Failed> {
        let mut all = vec!["--listen", "127.0.0.1:0"];
        all.extend(options);
        Self::start_as(folder, &all)
    }

    /// The same with all options.
    pub(crate) fn start_as(folder: &Path, options: &[&str]) -> Result<Self, Failed> {
        Self::start_memory(folder, "file:robot.rmem", options)
    }

    /// Serves another memory.
    fn start_memory(folder: &Path, memory: &str, options: &[&str]) -> Result<Self, Failed> {
        Self::spawn(folder, Command::new(env!("CARGO_BIN_EXE_rmem")), memory, options)
    }

    /// Serves the file of a folder by a process that may open so many files.
    fn start_limited(folder: &Path, files: u32) -> Result<Self, Failed> {
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("ulimit -n {files}; exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_rmem")]);
        Self::spawn(folder, shell, "file:robot.rmem", &["--listen", "127.0.0.1:0"])
    }

    fn spawn(folder: &Path, mut program: Command, memory: &str, options: &[&str]) -> Result<Self, Failed> {
        program.args(["--memory", memory, "serve", "--print-uri"]).args(options).stderr(Stdio::null());
        Self::ready(folder, &mut program)
    }

    /// Serves the file of a folder; gives what it says on stderr, too.
    fn start_heard(folder: &Path) -> Result<(Self, ChildStderr), Failed> {
        let mut program = Command::new(env!("CARGO_BIN_EXE_rmem"));
        let options = ["--memory", "file:robot.rmem", "serve", "--print-uri", "--listen", "127.0.0.1:0"];
        let mut served = Self::ready(folder, program.args(options).stderr(Stdio::piped()))?;
        let stderr = served.child.stderr.take().ok_or("no stderr")?;
        Ok((served, stderr))
    }

    fn ready(folder: &Path, program: &mut Command) -> Result<Self, Failed> {
        let program = program.current_dir(folder).env("HOME", folder).stdin(Stdio::null()).stdout(Stdio::piped());
        let mut child = program.spawn()?;
        let mut uri = String::new();
        BufReader::new(child.stdout.take().ok_or("no stdout")?).read_line(&mut uri)?;
        if uri.is_empty() {
            child.wait()?;
            return Err("it did not start".into());
        }
        Ok(Self { child, uri: uri.trim().to_owned() })
    }

    /// A client of it.
    pub(crate) fn client(&self) -> Result<Client, Failed> {
        Ok(Client::with_uri_str(&self.uri)?)
    }

    /// `host:port`
    fn address(&self) -> &str {
        self.uri.trim_start_matches("mongodb://").split('/').next().unwrap_or_default()
    }

    fn process(&self) -> Result<rustix::process::Pid, Failed> {
        Ok(rustix::process::Pid::from_raw(i32::try_from(self.child.id())?).ok_or("no process")?)
    }

    /// Ends it as a service manager does; gives its exit code.
    fn terminate(self) -> Result<Option<i32>, Failed> {
        rustix::process::kill_process(self.process()?, rustix::process::Signal::TERM)?;
        self.ended()
    }

    /// Waits until it has ended; gives its exit code.
    fn ended(mut self) -> Result<Option<i32>, Failed> {
        let since = Instant::now();
        while since.elapsed() < Duration::from_secs(20) {
            if let Some(status) = self.child.try_wait()? {
                return Ok(status.code());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Err("it does not end".into())
    }

    /// Ends it at once, as a loss of power does.
    fn kill(mut self) -> Result<(), Failed> {
        self.child.kill()?;
        self.child.wait()?;
        Ok(())
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What a server refused with.
fn code<T>(result: Result<T, mongodb::error::Error>) -> Option<i32> {
    use mongodb::error::{ErrorKind, WriteFailure};
    match *result.err()?.kind {
        ErrorKind::Command(command) => Some(command.code),
        ErrorKind::Write(WriteFailure::WriteError(write)) => Some(write.code),
        ErrorKind::InsertMany(many) => many.write_errors.and_then(|errors| errors.first().map(|error| error.code)),
        _ => None,
    }
}
