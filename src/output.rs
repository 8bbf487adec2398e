//! What rmem says: the product on stdout, everything said about it on stderr,
//! files whole or not at all.

use std::cell::RefCell;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use crate::formats::visible;
use crate::memory::{Observer, Operation};
use crate::process::litter;

/// How documents are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum Format {
    /// One document a line, relaxed Extended JSON.
    Jsonl,
    /// One JSON array, indented.
    Json,
    /// One document a line, canonical Extended JSON: every type spelled out.
    Canonical,
    /// Columns for people.
    Table,
    /// A plan, one action a line, as the planning competitions write it.
    Text,
    /// CLIPS facts.
    Clips,
    /// What FF prints.
    Ff,
    /// A stored document as it is, one line of JSON.
    Document,
    /// A graph for Graphviz.
    Dot,
    /// A drawing.
    Svg,
    /// A drawing of what was planned above what was done.
    Timeline,
    /// A scene, as MoveIt's `.scene` files have it.
    #[value(name = "moveit")]
    MoveIt,
    /// A scene, as MoveIt's message `PlanningScene`.
    #[value(name = "moveit-msg")]
    MoveItMessage,
    /// A scene, as MuJoCo reads it.
    Mjcf,
    /// A scene, as Gazebo and Drake read it.
    Sdf,
    /// A scene, as a robot description of ROS.
    Urdf,
    /// A scene, as OpenRAVE reads it.
    #[value(name = "openrave")]
    OpenRave,
}

impl Format {
    /// The word on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Jsonl => "jsonl",
            Self::Json => "json",
            Self::Canonical => "canonical",
            Self::Table => "table",
            Self::Text => "text",
            Self::Clips => "clips",
            Self::Ff => "ff",
            Self::Document => "document",
            Self::Dot => "dot",
            Self::Svg => "svg",
            Self::Timeline => "timeline",
            Self::MoveIt => "moveit",
            Self::MoveItMessage => "moveit-msg",
            Self::Mjcf => "mjcf",
            Self::Sdf => "sdf",
            Self::Urdf => "urdf",
            Self::OpenRave => "openrave",
        }
    }
}

/// How much is said on stderr.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Verbosity {
    /// Errors only.
    Quiet,
    /// Warnings and results worth a line.
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
    operations: Rc<RefCell<Vec<Operation>>>,
    deaf: bool,
}

impl<'a> Output<'a> {
    /// Output on these streams: normal verbosity, no colour, no log.
    pub fn new(stdout: &'a mut dyn Write, stderr: &'a mut dyn Write) -> Self {
        Self {
            stdout: BufWriter::new(Stdout(stdout)),
            stderr,
            verbosity: Verbosity::Normal,
            color: false,
            log: None,
            operations: Rc::default(),
            deaf: false,
        }
    }

    /// Sets what the settings say.
    ///
    /// # Errors
    /// Where the log cannot be opened.
    pub fn configure(&mut self, verbosity: Verbosity, color: bool, log: Option<&Path>) -> anyhow::Result<()> {
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

    /// The product's stream, buffered.
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

    /// Writes a line that tells of work which goes on whether or not somebody listens.
    ///
    /// # Errors
    /// Where stdout fails; that its reader went away is no failure.
    pub fn tell(&mut self, line: &str) -> io::Result<()> {
        let told = if self.deaf { Ok(()) } else { self.line(line) };
        self.heard(told)
    }

    /// Pushes out what was told.
    ///
    /// # Errors
    /// Where stdout fails; that its reader went away is no failure.
    pub fn flush_told(&mut self) -> io::Result<()> {
        let told = if self.deaf { Ok(()) } else { self.stdout.flush() };
        self.heard(told)
    }

    fn heard(&mut self, told: io::Result<()>) -> io::Result<()> {
        match told {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
                self.deaf = true;
                Ok(())
            }
            told => told,
        }
    }

    /// Pushes everything out.
    ///
    /// # Errors
    /// Where stdout is gone.
    pub fn flush(&mut self) -> io::Result<()> {
        self.stdout.flush()
    }

    /// Says something worth a line.
    pub fn note(&mut self, text: &str) {
        if self.verbosity >= Verbosity::Normal {
            self.say("", text);
        }
    }

    /// Warns.
    pub fn warn(&mut self, text: &str) {
        if self.verbosity >= Verbosity::Normal {
            let label = self.paint("33", "warning:");
            self.say(&label, text);
        }
    }

    /// Reports an error; said even under `-q`.
    pub fn error(&mut self, text: &str) {
        let label = self.paint("31", "error:");
        self.say(&label, text);
    }

    /// Passes on what a program that is run on somebody's behalf says on stderr.
    pub fn pass_on(&mut self, text: &[u8]) {
        // stderr gone is no reason to fail.
        let _ = self.stderr.write_all(text);
    }

    /// An observer for the memory, if operations are to be told or logged.
    #[must_use]
    pub fn observer(&self) -> Option<Observer> {
        let wanted = self.verbosity >= Verbosity::Verbose || self.log.is_some();
        let operations = Rc::clone(&self.operations);
        wanted.then(|| -> Observer { Rc::new(move |operation| operations.borrow_mut().push(operation.clone())) })
    }

    /// Tells and logs the operations that were observed since the last call.
    pub fn tell_operations(&mut self) {
        for operation in self.operations.take() {
            let subject = operation.namespace.map(|namespace| namespace.to_string()).unwrap_or_default();
            let detail = operation.count.map_or_else(|| "failed".to_owned(), |count| format!("{count} documents"));
            self.operation(&operation.name, &subject, &detail, operation.took);
        }
    }

    /// Tells under `-v`, and logs, what an operation did and how long it took.
    pub fn operation(&mut self, name: &str, subject: &str, detail: &str, took: Duration) {
        let milliseconds = took.as_secs_f64() * 1e3;
        if self.verbosity >= Verbosity::Verbose {
            let gap = if subject.is_empty() { "" } else { " " };
            self.say("", &format!("{name}{gap}{subject}: {detail} in {milliseconds:.2} ms"));
        }
        if let Some(log) = &mut self.log {
            let line = serde_json::json!({
                "operation": name, "subject": subject, "detail": detail, "milliseconds": milliseconds,
            });
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
    /// closed stderr is no reason to fail.
    fn say(&mut self, label: &str, text: &str) {
        let gap = if label.is_empty() { "" } else { " " };
        let _ = writeln!(self.stderr, "{label}{gap}{}", visible::lines(text));
    }

    /// Writes a product to a file, whole or not at all, or to stdout for `-`.
    ///
    /// # Errors
    /// Where the file cannot be written; the old one is then as it was.
    pub fn write_file(&mut self, path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
        self.write_with(path, |out| Ok(out.write_all(bytes)?))
    }

    /// The same for a product that is written as it is made.
    ///
    /// # Errors
    /// What `write` fails with, and where the file cannot be written; the old one is then as it was.
    pub fn write_with(
        &mut self,
        path: &Path,
        write: impl FnOnce(&mut dyn Write) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        if path == Path::new("-") || path == Path::new("/dev/stdout") {
            return write(&mut self.stdout);
        }
        let named = |error: io::Error| {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.exists());
            let text = match folder {
                Some(folder) => format!("there is no folder {}; make it first", folder.display()),
                None => error.to_string(),
            };
            WriteError(format!("cannot write {}: {text}", path.display())).into()
        };
        // The name of the temporary file is nobody's business in a message.
        write_atomically(path, write).map_err(|error| match error.downcast::<io::Error>() {
            Ok(error) => named(error),
            Err(error) => error,
        })
    }
}

/// A product could not be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct WriteError(String);

/// Standard output, which says its name when it fails.
struct Stdout<'a>(&'a mut dyn Write);

impl Write for Stdout<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes).map_err(named)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush().map_err(named)
    }
}

fn named(error: io::Error) -> io::Error {
    match error.kind() {
        io::ErrorKind::Interrupted | io::ErrorKind::BrokenPipe => error,
        kind => io::Error::new(kind, format!("cannot write to stdout: {error}")),
    }
}

/// Writes beside the target and renames. Devices and pipes are written directly;
/// a symbolic link stays one; an existing file keeps its permissions.
fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Write) -> anyhow::Result<()>) -> anyhow::Result<()> {
    let target: PathBuf = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let existing = fs::metadata(&target).ok();
    let special = existing.as_ref().is_some_and(|found| !found.is_file() && !found.is_dir());
    if special || path.starts_with("/dev/fd") || path.starts_with("/proc") {
        let mut out = BufWriter::new(OpenOptions::new().append(true).open(path)?);
        write(&mut out)?;
        return Ok(out.flush()?);
    }
    if existing.as_ref().is_some_and(fs::Metadata::is_dir) {
        return Err(io::Error::from(io::ErrorKind::IsADirectory).into());
    }
    let folder = match target.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    let prefix = litter::prefix(folder, ".rmem-");
    builder.prefix(&prefix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let unnamed = |error: io::Error| io::Error::from(error.kind());
    let file = builder.tempfile_in(folder).map_err(unnamed)?;
    let mut out = BufWriter::new(Unnamed(file.as_file()));
    write(&mut out)?;
    out.flush()?;
    drop(out);
    if let Some(existing) = existing {
        file.as_file().set_permissions(existing.permissions())?;
    }
    file.as_file().sync_all()?;
    file.persist(&target).map_err(|error| error.error)?;
    Ok(())
}

/// A temporary file, whose name is not in its errors.
struct Unnamed<'a>(&'a File);

impl Write for Unnamed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes).map_err(|error| io::Error::from(error.kind()))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Whether an error only says that the reader of stdout went away, which ends
/// rmem quietly, as it ends every filter.
#[must_use]
pub fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().filter_map(|cause| cause.downcast_ref::<io::Error>()).any(|io| io.kind() == io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_appear_whole_and_keep_their_permissions() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out");
        write_atomically(&path, |out| Ok(out.write_all(b"one")?)).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        write_atomically(&path, |out| Ok(out.write_all(b"two")?)).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_symbolic_link_stays_one() {
        let folder = tempfile::tempdir().unwrap();
        let (target, link) = (folder.path().join("target"), folder.path().join("link"));
        fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write_atomically(&link, |out| Ok(out.write_all(b"new")?)).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&target).unwrap(), b"new");
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        assert!(write_atomically(&folder.path().join("missing/out"), |out| Ok(out.write_all(b"x")?)).is_err());
        assert!(write_atomically(folder.path(), |out| Ok(out.write_all(b"x")?)).is_err());
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
