//! Output: the product on stdout, messages about it on stderr, files whole or not at all.

mod file;
mod format;
mod progress;

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use indicatif::ProgressBar;

use crate::error::{Error, Result};
use crate::fault::{AtFault, Fault};
use crate::formats::credentials::masked_message;
use crate::formats::{plain, visible};
pub use file::Pending;
use file::write_atomically;
pub use format::Format;
pub use progress::Progress;

/// Returns a number with its noun: `1 document`, `2 documents`, `3 indexes`.
pub(crate) fn amount(number: impl TryInto<u64>, noun: &str) -> String {
    let number = number.try_into().unwrap_or(u64::MAX);
    match number {
        1 => format!("1 {noun}"),
        _ if noun.ends_with('x') => format!("{number} {noun}es"),
        _ => format!("{number} {noun}s"),
    }
}

/// How much is printed on stderr.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Verbosity {
    /// Errors only.
    Quiet,
    /// Errors, warnings and short reports.
    #[default]
    Normal,
    /// Each operation with its duration.
    Verbose,
}

/// The two streams, and the log.
pub struct Output<'a> {
    stdout: BufWriter<Stdout<'a>>,
    stderr: &'a mut dyn Write,
    verbosity: Verbosity,
    color: bool,
    log: Option<File>,
    is_closed: bool,
    /// Whether the reader of stdout has closed it.
    closed: fn() -> bool,
    /// Whether stderr is a terminal.
    is_terminal: bool,
    /// The line that shows progress.
    bar: Option<ProgressBar>,
}

impl<'a> Output<'a> {
    /// Returns output on these streams: normal verbosity, no colour, no log.
    pub fn new(stdout: &'a mut dyn Write, stderr: &'a mut dyn Write) -> Self {
        Self {
            stdout: BufWriter::new(Stdout::new(stdout)),
            stderr,
            verbosity: Verbosity::Normal,
            color: false,
            log: None,
            is_closed: false,
            closed: || false,
            is_terminal: false,
            bar: None,
        }
    }

    /// Applies the settings.
    ///
    /// # Errors
    /// Where the log cannot be opened.
    pub fn configure(&mut self, verbosity: Verbosity, color: bool, log: Option<&Path>) -> Result<()> {
        self.verbosity = verbosity;
        self.color = color;
        self.log = match log {
            None => None,
            Some(path) => Some(
                OpenOptions::new()
                    .create(true)
                    .append(true)
                    .open(path)
                    .map_err(|error| WriteError(format!("cannot open the log {}: {error}", path.display())))?,
            ),
        };
        Ok(())
    }

    /// Says whether stderr is a terminal: progress is shown there.
    pub fn on_terminal(&mut self, is_terminal: bool) {
        self.is_terminal = is_terminal;
    }

    /// Says whether stdout is a terminal: control characters are shown there as escapes, since what is printed comes from
    /// documents that anyone may have stored.
    pub fn stdout_on_terminal(&mut self, is_terminal: bool) {
        self.stdout.get_mut().is_visible = is_terminal;
    }

    /// Returns the stream of stdout for a program that draws on the terminal itself.
    pub fn screen(&mut self) -> &mut dyn Write {
        self.stdout.get_mut().is_visible = false;
        &mut self.stdout
    }

    /// Takes a function that says whether the reader of stdout has closed it.
    pub fn closed_by(&mut self, closed: fn() -> bool) {
        self.closed = closed;
    }

    /// Returns what tells whether the reader of stdout has closed it; then there is nothing more to wait for.
    #[must_use]
    pub fn closed(&self) -> fn() -> bool {
        self.closed
    }

    /// Shows that something is being done, once that takes more than a second: on stderr where that is a
    /// terminal, and not under `-q`.
    pub fn progress(&mut self, text: &str) -> Progress {
        if !self.is_terminal || self.verbosity == Verbosity::Quiet {
            return Progress::hidden();
        }
        let (progress, bar) = Progress::on_terminal(text);
        self.bar = Some(bar);
        progress
    }

    /// Returns the product's stream, buffered.
    pub fn stdout(&mut self) -> &mut dyn Write {
        &mut self.stdout
    }

    /// Writes a line of the product.
    ///
    /// # Errors
    /// Where stdout is gone; see [`is_broken_pipe`].
    pub fn line(&mut self, line: &str) -> io::Result<()> {
        writeln!(self.stdout, "{line}")
    }

    /// Writes lines about work that has to go on when the reader of stdout closes it, and flushes them.
    ///
    /// # Errors
    /// Where stdout fails; a closed pipe is no failure.
    pub fn progress_lines(&mut self, lines: impl IntoIterator<Item = String>) -> io::Result<()> {
        if self.is_closed {
            return Ok(());
        }
        let written = lines.into_iter().try_for_each(|line| self.line(&line)).and_then(|()| self.flush());
        match written {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
                self.is_closed = true;
                Ok(())
            }
            written => written,
        }
    }

    /// Flushes stdout.
    ///
    /// # Errors
    /// Where stdout is gone.
    pub fn flush(&mut self) -> io::Result<()> {
        let stdout = &mut self.stdout;
        above(self.bar.as_ref(), || stdout.flush())
    }

    /// Prints a short report.
    pub fn note(&mut self, text: &str) {
        if self.verbosity >= Verbosity::Normal {
            self.print("", text);
        }
    }

    /// Prints a short report under `-v`.
    pub fn detail(&mut self, text: &str) {
        if self.is_verbose() {
            self.print("", text);
        }
    }

    /// Whether `-v` is given.
    #[must_use]
    pub fn is_verbose(&self) -> bool {
        self.verbosity >= Verbosity::Verbose
    }

    /// Prints a warning.
    pub fn warn(&mut self, text: &str) {
        if self.verbosity >= Verbosity::Normal {
            let label = self.paint("33", "warning:");
            self.print(&label, text);
        }
    }

    /// Prints an error, also under `-q`.
    pub fn error(&mut self, text: &str) {
        let label = self.paint("31", "error:");
        self.print(&label, text);
    }

    /// Passes on what a child process prints on stderr.
    pub fn pass_on(&mut self, text: &[u8]) {
        // A closed stderr is no error.
        let _ = self.stderr.write_all(text);
    }

    /// Whether short reports are printed.
    #[must_use]
    pub fn shows_notes(&self) -> bool {
        self.verbosity >= Verbosity::Normal
    }

    /// Whether operations are printed or logged.
    #[must_use]
    pub fn shows_operations(&self) -> bool {
        self.verbosity >= Verbosity::Verbose || self.log.is_some()
    }

    /// Prints (under `-v`) and logs what an operation did and how long it took.
    pub fn operation(&mut self, name: &str, subject: &str, detail: &str, took: Duration) {
        let milliseconds = took.as_secs_f64() * 1e3;
        if self.verbosity >= Verbosity::Verbose {
            let gap = if subject.is_empty() { "" } else { " " };
            self.print("", &format!("{name}{gap}{subject}: {detail} in {milliseconds:.2} ms"));
        }
        self.log(&serde_json::json!({
            "operation": name, "subject": subject, "detail": detail, "milliseconds": milliseconds,
        }));
    }

    /// Logs what a memory warned of.
    pub fn log_warning(&mut self, text: &str) {
        self.log(&serde_json::json!({ "warning": text }));
    }

    fn log(&mut self, line: &serde_json::Value) {
        if let Some(log) = &mut self.log {
            // A log that cannot be written must not fail the command; it is reported once.
            if let Err(error) = writeln!(log, "{line}") {
                self.log = None;
                self.warn(&format!("the log cannot be written, and ends here: {error}"));
            }
        }
    }

    fn paint(&self, code: &str, text: &str) -> String {
        if self.color { format!("\u{1b}[1;{code}m{text}\u{1b}[0m") } else { text.to_owned() }
    }

    /// Writes a line to stderr, behind a label, with control characters of the text visible. A
    /// closed stderr is no error.
    fn print(&mut self, label: &str, text: &str) {
        let gap = if label.is_empty() { "" } else { " " };
        let stderr = &mut self.stderr;
        let shown = plain::words(text);
        let shown = masked_message(&shown);
        let _ = above(self.bar.as_ref(), || writeln!(stderr, "{label}{gap}{}", visible::lines(&shown)));
    }

    /// Writes a product to a file, whole or not at all, or to a standard stream where that is named.
    ///
    /// # Errors
    /// Where the file cannot be written; the old one is then as it was.
    pub fn write_file(&mut self, path: &Path, bytes: &[u8]) -> Result<()> {
        self.write_with(path, |out| Ok(out.write_all(bytes)?))
    }

    /// The same for a product that is written as it is made.
    ///
    /// # Errors
    /// What `write` fails with, and where the file cannot be written; the old one is then as it was.
    pub fn write_with(&mut self, path: &Path, write: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
        match Standard::named(path) {
            Some(Standard::Out) => return write(&mut self.stdout),
            Some(Standard::Error) => return write(&mut self.stderr),
            None => {}
        }
        // A message names the target, and not the temporary file beside it.
        write_atomically(path, write).map_err(|error| match error.downcast::<io::Error>() {
            Ok(error) => unwritten(path, &error),
            Err(error) => error,
        })
    }

    /// Begins a product that is written before it is known whether it is right; nothing where that is not for a plain file.
    #[must_use]
    pub fn begin_file(&self, path: &Path) -> Option<Pending> {
        if Standard::named(path).is_some() { None } else { Pending::begin(path) }
    }

    /// Puts such a product in its place.
    ///
    /// # Errors
    /// Where the file cannot be written; the old one is then as it was.
    pub fn finish_file(&mut self, path: &Path, pending: Pending) -> Result<()> {
        pending.finish().map_err(|error| unwritten(path, &error))
    }
}

/// A standard stream of this process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Standard {
    Out,
    Error,
}

impl Standard {
    /// The stream that a path names. What it leads to may be a file with earlier content, and is not replaced.
    fn named(path: &Path) -> Option<Self> {
        match path.to_str()? {
            "-" | "/dev/stdout" | "/dev/fd/1" | "/proc/self/fd/1" => Some(Self::Out),
            "/dev/stderr" | "/dev/fd/2" | "/proc/self/fd/2" => Some(Self::Error),
            _ => None,
        }
    }
}

/// Whether a product that is written to a path goes to stdout.
#[must_use]
pub fn is_stdout(path: &Path) -> bool {
    Standard::named(path) == Some(Standard::Out)
}

/// The error of a file that cannot be written.
fn unwritten(path: &Path, error: &io::Error) -> Error {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.exists());
    let text = match folder {
        Some(folder) => format!("the folder {} does not exist; create it first", folder.display()),
        None => error.to_string(),
    };
    WriteError(format!("cannot write {}: {text}", path.display())).into()
}

/// Writes above the line that shows progress.
fn above<T>(bar: Option<&ProgressBar>, write: impl FnOnce() -> T) -> T {
    match bar.filter(|bar| !bar.is_finished()) {
        Some(bar) => bar.suspend(write),
        None => write(),
    }
}

/// A file cannot be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct WriteError(String);

impl AtFault for WriteError {
    fn fault(&self) -> Fault {
        Fault::Store
    }
}

/// Standard output; its errors name it.
struct Stdout<'a> {
    stream: &'a mut dyn Write,
    /// Whether control characters are shown as escapes.
    is_visible: bool,
    /// The first bytes of a character whose others have not come yet.
    rest: Vec<u8>,
}

impl<'a> Stdout<'a> {
    fn new(stream: &'a mut dyn Write) -> Self {
        Self { stream, is_visible: false, rest: Vec::new() }
    }

    /// Writes text with its control characters as escapes, but for a character that is cut at the end.
    fn write_visibly(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.rest.extend_from_slice(bytes);
        let text = std::mem::take(&mut self.rest);
        let cut = text.utf8_chunks().last().map_or(&[] as &[u8], |last| last.invalid());
        let is_cut = std::str::from_utf8(cut).is_err_and(|error| error.error_len().is_none());
        let whole = text.len() - if is_cut { cut.len() } else { 0 };
        self.rest.extend_from_slice(text.get(whole..).unwrap_or_default());
        let shown = String::from_utf8_lossy(text.get(..whole).unwrap_or_default());
        self.stream.write_all(visible::lines(&shown).as_bytes())
    }
}

impl Write for Stdout<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.is_visible {
            return self.write_visibly(bytes).map(|()| bytes.len()).map_err(named);
        }
        self.stream.write(bytes).map_err(named)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush().map_err(named)
    }
}

fn named(error: io::Error) -> io::Error {
    match error.kind() {
        io::ErrorKind::Interrupted | io::ErrorKind::BrokenPipe => error,
        kind => io::Error::new(kind, format!("cannot write to stdout: {error}")),
    }
}

/// Whether an error means that the reader of stdout closed it, which ends rmem
/// without a message, as it ends every filter.
#[must_use]
pub fn is_broken_pipe(error: &Error) -> bool {
    error.chain().filter_map(|cause| cause.downcast_ref::<io::Error>()).any(|io| io.kind() == io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_is_shown_control_characters_as_escapes_and_a_pipe_gets_them() {
        let text = "é\u{1b}[31m\u{202e}\u{9b}…\tx\n";
        for is_terminal in [true, false] {
            let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
            let mut output = Output::new(&mut stdout, &mut stderr);
            output.stdout_on_terminal(is_terminal);
            // Characters come in parts, too.
            for byte in text.bytes() {
                output.stdout().write_all(&[byte]).unwrap();
                output.flush().unwrap();
            }
            output.line(text).unwrap();
            drop(output);
            let shown = if is_terminal { "é\\u{1b}[31m\\u{202e}\\u{9b}…\tx\n" } else { text };
            assert_eq!(String::from_utf8(stdout).unwrap(), format!("{shown}{shown}\n"));
        }
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        let mut output = Output::new(&mut stdout, &mut stderr);
        output.stdout_on_terminal(true);
        output.stdout().write_all(b"a\xFF\x1b").unwrap();
        output.flush().unwrap();
        output.screen().write_all(b"\x1b[2J").unwrap();
        drop(output);
        assert_eq!(stdout, "a\u{FFFD}\\u{1b}\u{1b}[2J".as_bytes());
    }

    #[test]
    fn quiet_silences_all_but_errors() {
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        let mut output = Output::new(&mut stdout, &mut stderr);
        output.configure(Verbosity::Quiet, false, None).unwrap();
        output.note("n");
        output.warn("w");
        output.error("e");
        drop(output);
        assert_eq!(String::from_utf8(stderr).unwrap(), "error: e\n");
    }
}
