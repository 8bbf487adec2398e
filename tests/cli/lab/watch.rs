//! A command that runs beside the test and prints line after line.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use super::{Lab, rmem};

/// How long a test waits for a line, for the end of a process, or for something else.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(60);

/// Waits until something is so.
#[track_caller]
pub(crate) fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let since = Instant::now();
    while !is_so() {
        assert!(since.elapsed() < TIMEOUT, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits for the end of a process; gives its exit code.
#[track_caller]
pub(crate) fn end(child: &mut Child) -> i32 {
    let mut status = None;
    until("a process ends", || {
        status = child.try_wait().unwrap();
        status.is_some()
    });
    status.and_then(|status| status.code()).unwrap_or(-1)
}

/// A `watch` of some kind; killed when it is dropped.
pub(crate) struct Watch {
    pub(crate) child: Child,
    lines: Receiver<String>,
}

impl Watch {
    /// Starts rmem and waits until it says that it is ready.
    #[track_caller]
    pub(crate) fn rmem(lab: &Lab, args: &[&str], ready: &str) -> Self {
        let mut command = Command::new(rmem());
        command.args(args);
        Self::run(lab, command, ready)
    }

    /// Starts a command and waits for a line on stderr that begins so.
    #[track_caller]
    pub(crate) fn run(lab: &Lab, mut command: Command, ready: &str) -> Self {
        lab.isolate(&mut command);
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let (sender, lines) = channel();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || stdout.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        let mut message = String::new();
        BufReader::new(child.stderr.as_mut().unwrap()).read_line(&mut message).unwrap();
        assert!(message.starts_with(ready), "{message}");
        Self { child, lines }
    }

    /// The next line.
    #[track_caller]
    pub(crate) fn line(&self) -> String {
        self.lines.recv_timeout(TIMEOUT).expect("nothing was delivered")
    }

    /// The next line, without what differs from run to run.
    #[track_caller]
    pub(crate) fn next(&self) -> String {
        let line = self.line();
        match line.split_once(r#","time":"#) {
            Some((front, _)) => format!("{front}}}"),
            None => line,
        }
    }

    /// Waits for the end; gives the exit code, and what was delivered and not yet taken.
    #[track_caller]
    pub(crate) fn end(mut self) -> (i32, Vec<String>) {
        let code = end(&mut self.child);
        (code, self.lines.iter().collect())
    }

    pub(crate) fn signal(&self, signal: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-s", signal, &id]).status().unwrap().success());
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
