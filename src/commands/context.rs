//! What a command works with: settings, streams, and the memory once it is asked for.

use std::io::{BufRead, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use anyhow::Context as _;
use bson::Document;

use crate::formats::{Source, shell, visible};
use crate::input::{UsageError, decode, unreadable};
use crate::memory::computables::Registry;
use crate::memory::dump::world_file::{WorldError, WorldFile};
use crate::memory::{Memory, Observer};
use crate::output::{Format, Output};
use crate::process::Host;
use crate::settings::{Environment, Origin, Settings};
use crate::store::StoreUri;

/// What a command works with.
pub struct Context<'a> {
    /// The settings in force.
    pub settings: Settings,
    /// Where the command speaks.
    pub output: Output<'a>,
    /// The environment variables, for programs that rmem looks for.
    pub environment: Environment,
    /// rmem itself, for child processes.
    pub executable: PathBuf,
    /// Describes the command line, for what is generated from it.
    pub command_line: fn() -> clap::Command,
    stdin: Option<&'a mut dyn BufRead>,
    terminal: bool,
}

impl<'a> Context<'a> {
    pub(crate) fn new(
        settings: Settings,
        output: Output<'a>,
        stdin: &'a mut dyn BufRead,
        terminal: bool,
        executable: PathBuf,
        environment: Environment,
        command_line: fn() -> clap::Command,
    ) -> Self {
        Self { settings, output, environment, executable, command_line, stdin: Some(stdin), terminal }
    }

    /// The memory, with the world files of `--load` in it. A file that was named for this
    /// run has to be there: a slip of the pen is no empty memory.
    ///
    /// # Errors
    /// Where a store cannot be opened or a world file is wrong.
    pub fn memory(&mut self) -> anyhow::Result<Memory> {
        let memory = self.memory_to_fill()?;
        Ok(match self.settings.memory.origin {
            Origin::Flag(_) | Origin::Environment(_) => memory.expecting_files(),
            Origin::Default | Origin::File(..) => memory,
        })
    }

    /// The same for what stores something in any case: it makes the file.
    ///
    /// # Errors
    /// As [`Context::memory`].
    pub fn memory_to_fill(&mut self) -> anyhow::Result<Memory> {
        let memory = self.opening().open(self.output.observer())?;
        for path in self.settings.load.clone() {
            let start = Instant::now();
            let (name, world) = self.world(&path)?;
            let loaded = world.and_then(|world| world.load(&memory));
            let loaded = loaded.with_context(|| format!("loading {}", path.display()))?;
            self.output.operation("load", &name, &loaded.to_string(), start.elapsed());
        }
        Ok(memory)
    }

    /// A world file, and what messages call it. It may be larger than memory where it can be read
    /// twice, as stdin and pipes cannot.
    fn world(&mut self, path: &Path) -> anyhow::Result<(String, Result<WorldFile, WorldError>)> {
        if !path.is_file() {
            let source = self.read(path)?;
            let wrong = |error| WorldError::Text { name: source.name().to_owned(), source: error };
            return Ok((source.name().to_owned(), WorldFile::parse(&source).map_err(wrong)));
        }
        let name = path.display().to_string();
        Ok((name, WorldFile::open(path).map_err(WorldError::from)))
    }

    /// What a memory is opened with, in whichever thread; the world files of `--load` are not in it.
    #[must_use]
    pub fn opening(&self) -> Opening {
        Opening { settings: self.settings.clone(), host: self.host() }
    }

    /// A line of stdin with its end; none where there is no more.
    ///
    /// # Errors
    /// Where stdin was read as a file, or cannot be read.
    #[cfg(feature = "clips-engine")]
    pub(super) fn read_line(&mut self) -> anyhow::Result<Option<Vec<u8>>> {
        let Some(stdin) = &mut self.stdin else { return Ok(None) };
        let mut line = Vec::new();
        stdin.read_until(b'\n', &mut line).map_err(|error| unreadable("stdin", &error))?;
        Ok((!line.is_empty()).then_some(line))
    }

    /// What programs are run with that end when rmem does.
    #[must_use]
    pub fn host(&self) -> Host<'static> {
        static NEVER: AtomicBool = AtomicBool::new(false);
        Host { exe: self.executable.clone(), temporary: self.temporary(), interrupted: &NEVER }
    }

    /// Where temporary directories are made.
    #[must_use]
    pub fn temporary(&self) -> PathBuf {
        self.environment.get("TMPDIR").map_or_else(|| "/tmp".into(), Into::into)
    }

    /// Where a program is: a path as it is, a name among the folders of PATH.
    #[must_use]
    pub fn program(&self, name: &str) -> Option<PathBuf> {
        if name.contains('/') {
            return Some(PathBuf::from(name)).filter(|path| path.is_file());
        }
        let path = self.environment.get("PATH").map_or("", String::as_str);
        path.split(':').map(|folder| Path::new(folder).join(name)).find(|candidate| candidate.is_file())
    }

    /// Reads a whole text file, or stdin for `-`.
    ///
    /// # Errors
    /// Where it cannot be read, or is not UTF-8.
    pub fn read(&mut self, path: &Path) -> anyhow::Result<Source> {
        let mut bytes = Vec::new();
        let name = if path == Path::new("-") {
            self.take_stdin()?.read_to_end(&mut bytes).map_err(|error| unreadable("stdin", &error))?;
            "<stdin>".to_owned()
        } else {
            let name = path.display().to_string();
            bytes = std::fs::read(path).map_err(|error| unreadable(&name, &error))?;
            name
        };
        Ok(decode(&name, bytes)?)
    }

    /// Standard input for itself, so that results can be printed while it is read.
    ///
    /// # Errors
    /// Where something else has read it already.
    pub fn take_stdin(&mut self) -> Result<&'a mut dyn BufRead, UsageError> {
        self.stdin
            .take()
            .ok_or_else(|| UsageError::new("stdin can be read only once; expected `-` for one input at most"))
    }

    /// Whether stdout is a terminal.
    #[must_use]
    pub fn is_terminal(&self) -> bool {
        self.terminal
    }

    /// The format in force: what was set, else a table on a terminal, else JSON lines.
    ///
    /// # Errors
    /// Where a format was set that this command does not print.
    pub fn format(&self, allowed: &[Format]) -> Result<Format, UsageError> {
        let Some(format) = self.settings.format.value else {
            let table = self.terminal && allowed.contains(&Format::Table);
            return Ok(if table { Format::Table } else { allowed[0] });
        };
        if allowed.contains(&format) {
            return Ok(format);
        }
        if !matches!(self.settings.format.origin, Origin::Flag(_)) {
            // A format that is set for good is meant for the commands that have it.
            return Ok(allowed[0]);
        }
        let names: Vec<_> = allowed.iter().map(|format| format.name()).collect();
        Err(UsageError::new(format!("this command has no format `{}`; it has {}", format.name(), names.join(", "))))
    }

    /// Prints documents as they come, in the format in force; returns how many.
    ///
    /// # Errors
    /// Where a document cannot be had or stdout is gone.
    pub fn print_documents(
        &mut self,
        documents: impl Iterator<Item = anyhow::Result<Document>>,
    ) -> anyhow::Result<u64> {
        let format = self.format(&[Format::Jsonl, Format::Json, Format::Canonical, Format::Table])?;
        let stdout = self.output.stdout();
        let mut count = 0;
        let mut rows = Vec::new();
        for document in documents {
            let document = match document {
                Ok(document) => document,
                Err(error) => {
                    if format == Format::Json && count > 0 {
                        writeln!(stdout)?;
                    }
                    return Err(error);
                }
            };
            match format {
                Format::Canonical => writeln!(stdout, "{}", shell::canonical(&document))?,
                Format::Json => {
                    let separator = if count == 0 { "[\n" } else { ",\n" };
                    write!(stdout, "{separator}{}", shell::pretty(&document.into()))?;
                }
                Format::Table => {
                    rows.push(document);
                    if rows.len() == TABLE_ROWS {
                        print_table(&mut rows, count + 1 > TABLE_ROWS as u64, stdout)?;
                    }
                }
                _ => writeln!(stdout, "{}", shell::relaxed(&document))?,
            }
            count += 1;
        }
        match format {
            Format::Json => writeln!(stdout, "{}", if count == 0 { "[]" } else { "\n]" })?,
            Format::Table if !rows.is_empty() => print_table(&mut rows, count > TABLE_ROWS as u64, stdout)?,
            _ => {}
        }
        Ok(count)
    }
}

/// What a memory is opened with.
#[derive(Debug, Clone)]
pub struct Opening {
    settings: Settings,
    host: Host<'static>,
}

impl Opening {
    /// Opens the memory.
    ///
    /// # Errors
    /// Where a store cannot be opened, or a computable is wrong.
    pub fn open(&self, observer: Option<Observer>) -> anyhow::Result<Memory> {
        let registry = Registry::new(self.settings.computables.clone(), &self.host)?;
        let memory = open(&self.settings)?.with_computables(registry);
        Ok(match observer {
            Some(observer) => memory.with_observer(observer),
            None => memory,
        })
    }
}

/// The memory at one URI, for both kinds of databases.
///
/// # Errors
/// Where the URI is none.
pub(super) fn memory_at(uri: &str) -> anyhow::Result<Memory> {
    let uri = StoreUri::parse(uri).map_err(|error| UsageError::new(error.to_string()))?;
    Ok(Memory::at(uri.clone(), uri, Vec::new()))
}

/// The stores that the settings name; each is contacted when it is first used.
fn open(settings: &Settings) -> anyhow::Result<Memory> {
    let local = settings.memory.value.as_deref().ok_or_else(|| {
        UsageError::new("no memory is set and no data directory is known; expected --memory URI, like file:robot.rmem")
    })?;
    let parse = |uri: &str, origin: &Origin| {
        StoreUri::parse(uri).map_err(|error| UsageError::new(format!("{error} (set by {origin})")))
    };
    let local = parse(local, &settings.memory.origin)?;
    if settings.memory.origin == Origin::Default
        && let Some(folder) = local.path().and_then(Path::parent)
    {
        // The user's data directory is rmem's to make; a folder that somebody named is not.
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let shared = match &settings.shared.value {
        Some(uri) => parse(uri, &settings.shared.origin)?,
        None => local.clone(),
    };
    Ok(Memory::at(local, shared, settings.shared_databases.value.clone()))
}

/// How many rows a table has at most. More documents are printed as several tables, each with its
/// own heading, so that memory stays bounded.
const TABLE_ROWS: usize = 1_000;

/// Prints the rows as a table, behind an empty line where it is not the first, and clears them.
fn print_table(rows: &mut Vec<Document>, is_later: bool, out: &mut dyn std::io::Write) -> std::io::Result<()> {
    writeln!(out, "{}{}", if is_later { "\n" } else { "" }, table(rows)?)?;
    rows.clear();
    Ok(())
}

/// Columns for people: a column a top-level key, in order of first appearance.
fn table(rows: &[Document]) -> std::io::Result<String> {
    let mut keys: Vec<&str> = Vec::new();
    for key in rows.iter().flat_map(Document::keys) {
        if !keys.contains(&key.as_str()) {
            keys.push(key);
        }
    }
    let headings: Vec<_> = keys.iter().map(|key| visible::line(key)).collect();
    let mut text = headings.join("\t");
    for row in rows {
        let cells: Vec<String> = keys.iter().map(|key| row.get(key).map(cell).unwrap_or_default()).collect();
        text.push('\n');
        text.push_str(&cells.join("\t"));
    }
    let mut aligned = tabwriter::TabWriter::new(Vec::new());
    aligned.write_all(text.as_bytes())?;
    aligned.flush()?;
    let aligned = aligned.into_inner().map_err(|error| std::io::Error::other(error.to_string()))?;
    let text = String::from_utf8_lossy(&aligned).into_owned();
    Ok(text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n"))
}

/// A value in a table: strings bare, the rest as JSON, line breaks and escapes made visible.
fn cell(value: &bson::Bson) -> String {
    match value {
        bson::Bson::String(text) => visible::line(text).into_owned(),
        bson::Bson::ObjectId(id) => id.to_hex(),
        other => visible::line(&shell::relaxed_value(other)).into_owned(),
    }
}
