//! The context of a command: settings, streams, and the memory when it is first used.

use std::ffi::OsStr;
use std::io::BufRead;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use crate::error::{Context as _, Result};
use crate::formats::Source;
use crate::input::{UsageError, decode, decode_clips, decode_pddl, unreadable};
use crate::memory::computables::Registry;
use crate::memory::dump::world_file::{WorldError, WorldFile};
use crate::memory::{Memory, Observer, Operation};
use crate::output::Output;
use crate::output::amount;
use crate::planner;
use crate::process::{Host, Listener, search};
use crate::settings::{Environment, Origin, Settings};
use crate::store::{StoreUri, Warn};

/// The name of stdin in messages.
pub(super) const STDIN: &str = "<stdin>";

/// The context of a command.
pub struct Context<'a> {
    /// The settings in force.
    pub settings: Settings,
    /// Its output.
    pub output: Output<'a>,
    /// The environment variables, e.g. to search programs.
    pub environment: Environment,
    /// rmem itself, for child processes.
    pub executable: PathBuf,
    /// Describes the command line, for what is generated from it.
    pub command_line: fn() -> clap::Command,
    /// What the history of the memory calls this command.
    pub author: String,
    stdin: Option<&'a mut dyn BufRead>,
    pub(super) terminal: bool,
    pub(super) columns: Option<usize>,
    operations: Arc<Mutex<Vec<Operation>>>,
    /// What a memory warned of, in whichever thread.
    warnings: Arc<Mutex<Vec<String>>>,
}

impl<'a> Context<'a> {
    #[expect(clippy::too_many_arguments, reason = "what a process gives to a command, each once")]
    pub(crate) fn new(
        settings: Settings,
        output: Output<'a>,
        stdin: &'a mut dyn BufRead,
        terminal: bool,
        columns: Option<usize>,
        executable: PathBuf,
        environment: Environment,
        command_line: fn() -> clap::Command,
    ) -> Self {
        let columns = environment.get("COLUMNS").and_then(|columns| columns.parse().ok()).or(columns);
        Self {
            settings,
            output,
            environment,
            executable,
            command_line,
            author: "rmem".to_owned(),
            stdin: Some(stdin),
            terminal,
            columns,
            operations: Arc::default(),
            warnings: Arc::default(),
        }
    }

    /// Returns the memory, with the world files of `--load` in it. A file named by a flag or a variable
    /// has to exist: a mistyped path must not open an empty memory.
    ///
    /// # Errors
    /// Where a store cannot be opened or a world file is wrong.
    pub fn memory(&mut self) -> Result<Memory> {
        let memory = self.memory_to_fill()?;
        Ok(match self.settings.memory.origin {
            Origin::Flag(_) | Origin::Environment(_) => memory.expecting_files(),
            Origin::Default | Origin::File(..) => memory,
        })
    }

    /// Returns the memory for a command that stores something: the file is created if it does not exist.
    ///
    /// # Errors
    /// As [`Context::memory`].
    pub fn memory_to_fill(&mut self) -> Result<Memory> {
        let warnings = Arc::clone(&self.warnings);
        let memory = self.opening().open(self.observer())?;
        let memory = memory.with_warnings(Arc::new(move |warning| push(&warnings, warning)));
        let paths = self.settings.load.clone();
        for (nth, path) in paths.iter().enumerate() {
            let start = Instant::now();
            let (name, world) = self.world(path)?;
            let loaded = world.and_then(|world| world.load(&memory));
            let loaded = loaded.with_context(|| match paths.get(..nth) {
                Some(before @ [_, ..]) => {
                    let before: Vec<String> = before.iter().map(|path| path.display().to_string()).collect();
                    format!("loading {}; the memory has those before it: {}", path.display(), before.join(", "))
                }
                _ => format!("loading {}", path.display()),
            })?;
            self.output.operation("load", &name, &loaded.to_string(), start.elapsed());
        }
        Ok(memory)
    }

    /// Returns a world file, and its name for messages. A regular file is read twice, and may be larger
    /// than memory; stdin and pipes are read into memory.
    fn world(&mut self, path: &Path) -> Result<(String, Result<WorldFile, WorldError>)> {
        if !path.is_file() {
            let source = self.read(path)?;
            let wrong = |error| WorldError::Text { name: source.name().to_owned(), source: error };
            return Ok((source.name().to_owned(), WorldFile::parse(&source).map_err(wrong)));
        }
        let name = path.display().to_string();
        Ok((name, WorldFile::open(path).map_err(WorldError::from)))
    }

    /// Returns an observer for a memory, where operations are printed or logged.
    #[must_use]
    pub fn observer(&self) -> Option<Observer> {
        let operations = Arc::clone(&self.operations);
        self.output
            .shows_operations()
            .then(|| -> Observer { Arc::new(move |operation| lock(&operations).push(operation.clone())) })
    }

    /// Prints and logs the warnings that a memory gave, and the operations that were observed, since the last call.
    pub fn report_operations(&mut self) {
        let warnings = taken(&self.warnings);
        for warning in warnings {
            self.output.warn(&warning);
            self.output.log_warning(&warning);
        }
        for operation in taken(&self.operations) {
            let subject = operation.namespace.map(|namespace| namespace.to_string()).unwrap_or_default();
            let detail = operation.count.map_or_else(|| "failed".to_owned(), |count| amount(count, "document"));
            self.output.operation(&operation.name, &subject, &detail, operation.took);
        }
    }

    /// Returns what is needed to open the memory in another thread, without the world files of `--load`.
    #[must_use]
    pub fn opening(&self) -> Opening {
        let (settings, author) = (self.settings.clone(), self.author.clone());
        Opening { settings, author, host: self.host(), warnings: Arc::clone(&self.warnings) }
    }

    /// Reads a line of stdin with its end; `None` at the end of the input.
    ///
    /// # Errors
    /// Where stdin was read as a file, or cannot be read.
    #[cfg(feature = "clips-engine")]
    pub(super) fn read_line(&mut self) -> Result<Option<Vec<u8>>> {
        let Some(stdin) = &mut self.stdin else { return Ok(None) };
        let mut line = Vec::new();
        stdin.read_until(b'\n', &mut line).map_err(|error| unreadable("stdin", &error))?;
        Ok((!line.is_empty()).then_some(line))
    }

    /// Returns the host of child processes, which end when rmem does.
    #[must_use]
    pub fn host(&self) -> Host<'static> {
        static NEVER: AtomicBool = AtomicBool::new(false);
        let listener = Listener::default();
        Host { exe: self.executable.clone(), temporary: self.temporary(), interrupted: &NEVER, listener }
    }

    /// Returns the folder of temporary directories.
    #[must_use]
    pub fn temporary(&self) -> PathBuf {
        let set = self.environment.get("TMPDIR").filter(|folder| !folder.is_empty());
        set.map_or_else(|| "/tmp".into(), Into::into)
    }

    /// Returns where a program is, a path or a name in the folders of PATH.
    #[must_use]
    pub fn program(&self, name: &str) -> Option<PathBuf> {
        search::find(name.as_ref(), self.environment.get("PATH").map(OsStr::new))
    }

    /// Returns the planners of the settings, and those that rmem knows.
    #[must_use]
    pub fn planners(&self) -> planner::Registry {
        planner::Registry::new(self.settings.planners.clone(), self.program("ff"))
    }

    /// Reads a whole text file, or stdin for `-`.
    ///
    /// # Errors
    /// Where it cannot be read, or is not UTF-8.
    pub fn read(&mut self, path: &Path) -> Result<Source> {
        let (name, bytes) = self.read_bytes(path)?;
        Ok(decode(&name, bytes)?)
    }

    /// As [`Self::read`], for PDDL and plans, whose comments may have any bytes.
    ///
    /// # Errors
    /// Where it cannot be read, or is not UTF-8 outside of comments.
    pub fn read_pddl(&mut self, path: &Path) -> Result<Source> {
        let (name, bytes) = self.read_bytes(path)?;
        Ok(decode_pddl(&name, bytes)?)
    }

    /// As [`Self::read`], for CLIPS, whose comments may have any bytes.
    ///
    /// # Errors
    /// Where it cannot be read, or is not UTF-8 outside of comments.
    pub fn read_clips(&mut self, path: &Path) -> Result<Source> {
        let (name, bytes) = self.read_bytes(path)?;
        Ok(decode_clips(&name, bytes)?)
    }

    fn read_bytes(&mut self, path: &Path) -> Result<(String, Vec<u8>)> {
        let mut bytes = Vec::new();
        let name = if path == Path::new("-") {
            self.take_stdin()?.read_to_end(&mut bytes).map_err(|error| unreadable("stdin", &error))?;
            STDIN.to_owned()
        } else {
            let name = path.display().to_string();
            bytes = std::fs::read(path).map_err(|error| unreadable(&name, &error))?;
            name
        };
        Ok((name, bytes))
    }

    /// Takes standard input, so that results can be printed while it is read.
    ///
    /// # Errors
    /// Where it was read before.
    pub fn take_stdin(&mut self) -> Result<&'a mut dyn BufRead, UsageError> {
        self.stdin
            .take()
            .ok_or_else(|| UsageError::new("stdin can be read only once; expected `-` for one input at most"))
    }

    /// Returns whether stdout is a terminal.
    #[must_use]
    pub fn is_terminal(&self) -> bool {
        self.terminal
    }
}

/// What is needed to open a memory.
#[derive(Debug, Clone)]
pub struct Opening {
    settings: Settings,
    author: String,
    host: Host<'static>,
    /// Where the warnings of stores go.
    warnings: Arc<Mutex<Vec<String>>>,
}

/// The most warnings that wait: those of a long command are too many to be read.
const MOST_WARNINGS: usize = 1_000;

fn lock<T>(items: &Mutex<Vec<T>>) -> MutexGuard<'_, Vec<T>> {
    items.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What there is, which is not there any more.
fn taken<T>(items: &Mutex<Vec<T>>) -> Vec<T> {
    std::mem::take(&mut *lock(items))
}

/// Keeps a warning until it is printed.
fn push(warnings: &Mutex<Vec<String>>, warning: &str) {
    let mut warnings = lock(warnings);
    match warnings.len() {
        MOST_WARNINGS.. => {}
        count if count + 1 == MOST_WARNINGS => warnings.push("further warnings are left out".to_owned()),
        _ => warnings.push(warning.to_owned()),
    }
}

impl Opening {
    /// Opens the memory.
    ///
    /// # Errors
    /// Where a store cannot be opened, or a computable is wrong.
    pub fn open(&self, observer: Option<Observer>) -> Result<Memory> {
        let registry = Registry::new(self.settings.computables.clone(), &self.host)?;
        let memory = open(&self.settings)?.with_computables(registry);
        let memory = memory.with_history(&self.settings.histories.value, &self.author);
        let warnings = Arc::clone(&self.warnings);
        let warn: Warn = Arc::new(move |warning| push(&warnings, warning));
        let memory = memory.warning_by(&warn);
        Ok(match observer {
            Some(observer) => memory.with_observer(observer),
            None => memory,
        })
    }
}

/// Returns the memory at one URI, for local and shared databases.
///
/// # Errors
/// Where the URI is malformed.
pub(super) fn memory_at(uri: &str) -> Result<Memory> {
    let uri = StoreUri::parse(uri)?;
    Ok(Memory::at(uri.clone(), uri, Vec::new()))
}

/// Returns the address of a store; an error names the origin. One in a settings file was checked when that was read.
pub(super) fn parse_uri(uri: &str, origin: &Origin) -> Result<StoreUri, UsageError> {
    StoreUri::parse(uri).map_err(|error| UsageError::new(format!("{error} (set by {origin})")))
}

/// Returns the memory of the settings; each store is contacted when it is first used.
fn open(settings: &Settings) -> Result<Memory> {
    let local = settings.memory.value.as_deref().ok_or_else(|| {
        UsageError::new("no memory is set and no data directory is known; expected --memory URI, like file:robot.rmem")
    })?;
    let local = parse_uri(local, &settings.memory.origin)?;
    if settings.memory.origin == Origin::Default
        && let Some(folder) = local.path().and_then(Path::parent)
    {
        // rmem creates the user's data directory, but no folder that a user names.
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let shared = match &settings.shared.value {
        Some(uri) => parse_uri(uri, &settings.shared.origin)?,
        None => local.clone(),
    };
    Ok(Memory::at(local, shared, settings.shared_databases.value.clone()))
}
