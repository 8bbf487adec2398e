//! Settings: defaults < `rmem.toml` < environment < flags, each value with its origin.
//!
//! [`Settings::resolve`] is the one place that layers them. It opens the settings file
//! and nothing else.

pub mod backend;
mod computable;
pub mod file;
mod flags;
mod history;
mod quoted;
mod scene;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use crate::error::{Context as _, Error, Result};
use crate::input::{UsageError, decode, unreadable};
use crate::memory::computables::Definition;
use crate::output::{Format, Verbosity};
use crate::planner::Configured;
use crate::scene::ObjectKind;
use crate::store::{HistoryRule, Namespace};
use file::File;

pub use computable::read_kept;
pub use flags::{Color, Flags};

/// The default namespace.
const DEFAULT_COLLECTION: &str = "robmem.worldmodel";

/// The environment variables of a process, as a value.
pub type Environment = BTreeMap<String, String>;

/// The origin of a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// The built-in default.
    Default,
    /// A settings file, and the line in it.
    File(PathBuf, usize),
    /// An environment variable.
    Environment(&'static str),
    /// A flag of the command line.
    Flag(&'static str),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => write!(f, "default"),
            Self::File(path, line) => write!(f, "{}:{line}", path.display()),
            Self::Environment(name) => write!(f, "environment variable {name}"),
            Self::Flag(name) => write!(f, "{name}"),
        }
    }
}

/// A value with its origin.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Setting<T> {
    /// The value.
    pub value: T,
    /// Its origin.
    pub origin: Origin,
}

impl<T> Setting<T> {
    fn default(value: T) -> Self {
        Self { value, origin: Origin::Default }
    }

    /// Returns a value that may be absent.
    fn of(setting: Option<Self>) -> Setting<Option<T>> {
        setting.map_or_else(|| Setting::default(None), |setting| setting.map(Some))
    }

    fn map<U>(self, change: impl FnOnce(T) -> U) -> Setting<U> {
        Setting { value: change(self.value), origin: self.origin }
    }

    /// Changes a value of a settings file, e.g. to a path relative to that file.
    fn located(self, change: impl FnOnce(T) -> T) -> Self {
        match self.origin {
            Origin::File(..) => self.map(change),
            _ => self,
        }
    }
}

impl Setting<String> {
    /// Parses the text; an error names its origin.
    fn read<U, E>(self, read: impl FnOnce(&str) -> Result<U, E>) -> Result<Setting<U>>
    where
        E: Into<Error>,
    {
        let value = read(&self.value).with_context(|| format!("set by {}", self.origin))?;
        Ok(Setting { value, origin: self.origin })
    }
}

/// The layers below the flags: the settings file, and above it the environment.
struct Layers<'a> {
    path: &'a Path,
    file: &'a File,
    environment: &'a Environment,
}

impl Layers<'_> {
    /// Returns the value of an environment variable, else that of the settings file.
    fn text(&self, in_file: &Option<toml::Spanned<String>>, variable: &'static str) -> Option<Setting<String>> {
        let environment = set(self.environment, variable)
            .map(|value| Setting { value: value.clone(), origin: Origin::Environment(variable) });
        environment.or_else(|| {
            in_file.as_ref().map(|text| Setting { value: text.get_ref().clone(), origin: self.place(text) })
        })
    }

    /// Returns the place of a value in the settings file.
    fn place<T>(&self, value: &toml::Spanned<T>) -> Origin {
        Origin::File(self.path.to_owned(), self.file.line(value.span()))
    }
}

/// Puts the value of a flag above the layers below it.
fn flag<T>(below: Option<Setting<T>>, name: &'static str, given: Option<T>) -> Option<Setting<T>> {
    given.map(|value| Setting { value, origin: Origin::Flag(name) }).or(below)
}

/// Returns the value of an environment variable; an empty one counts as not set.
fn set<'e>(environment: &'e Environment, name: &str) -> Option<&'e String> {
    environment.get(name).filter(|value| !value.is_empty())
}

/// The settings in force.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The settings file in use.
    pub file: Option<PathBuf>,
    /// URI of the local store; `None` if no data directory is known.
    pub memory: Setting<Option<String>>,
    /// URI of the store of shared databases; `None` is the local one.
    pub shared: Setting<Option<String>>,
    /// The databases in the store `shared`.
    pub shared_databases: Setting<Vec<String>>,
    /// The default namespace.
    pub collection: Setting<Namespace>,
    /// Folders of templates that templates name.
    pub template_path: Setting<Vec<PathBuf>>,
    /// The format of results; `None` means the default of the command.
    pub format: Setting<Option<Format>>,
    /// How much is printed on stderr.
    pub verbosity: Verbosity,
    /// Whether stderr is coloured.
    pub color: bool,
    /// The log of operations.
    pub log: Setting<Option<PathBuf>>,
    /// World files to load before the command.
    pub load: Vec<PathBuf>,
    /// The configured planners.
    pub planners: Vec<Configured>,
    /// The configured computables.
    pub computables: Vec<Definition>,
    /// Whose history is kept.
    pub histories: Setting<Vec<HistoryRule>>,
    /// The most bytes of changes that are kept; each of `histories` has them.
    pub history_size: Setting<u64>,
    /// The most documents that collections keep.
    pub most_documents: BTreeMap<Namespace, u64>,
    /// Kinds of objects in scenes, by configuration.
    pub object_kinds: Vec<ObjectKind>,
    /// The mongod processes of this robot.
    pub backends: Vec<backend::Backend>,
}

impl Settings {
    /// Layers defaults, settings file, environment and flags.
    ///
    /// # Errors
    /// A settings file that is missing, unreadable or wrong, with its position;
    /// a variable or flag whose value is not acceptable.
    pub fn resolve(flags: &Flags, environment: &Environment, directory: &Path, terminal: bool) -> Result<Self> {
        let is_invalid = |(name, value): &(&String, &String)| name.starts_with("RMEM_") && value.contains('\u{fffd}');
        if let Some((name, _)) = environment.iter().find(is_invalid) {
            return Err(UsageError::new(format!("the environment variable {name} is not valid UTF-8")).into());
        }
        let path = find_file(flags, environment, directory)?;
        let file = match &path {
            Some(path) => read_file(path)?,
            None => File::default(),
        };
        let folder = path.as_deref().and_then(Path::parent).unwrap_or(directory);
        let below = Layers { path: path.as_deref().unwrap_or(directory), file: &file, environment };

        let memory = below.text(&file.memory, "RMEM_MEMORY").map(|uri| uri.located(|uri| relative_uri(folder, &uri)));
        let memory = flag(memory, "--memory", flags.memory.clone())
            .map_or_else(|| Setting::default(default_memory(environment)), |uri| uri.map(Some));
        let shared = below.text(&file.shared, "RMEM_SHARED").map(|uri| uri.located(|uri| relative_uri(folder, &uri)));
        let shared = Setting::of(flag(shared, "--shared", flags.shared.clone()));
        let shared_databases = file.shared_databases.as_ref().map_or_else(
            || Setting::default(Vec::new()),
            |databases| Setting { value: names(databases.get_ref()), origin: below.place(databases) },
        );
        let collection = below.text(&file.collection, "RMEM_COLLECTION");
        let collection = flag(collection, "--collection", flags.collection.clone())
            .unwrap_or_else(|| Setting::default(DEFAULT_COLLECTION.to_owned()))
            .read(str::parse)?;
        let template_path = file.template_path.as_ref().map_or_else(
            || Setting::default(Vec::new()),
            |paths| Setting {
                value: paths.get_ref().iter().map(|path| folder.join(path)).collect(),
                origin: below.place(paths),
            },
        );
        // A wrong name is no obstacle where the flag overrules it.
        let format = below.text(&file.format, "RMEM_FORMAT").filter(|_| flags.format.is_none());
        let format = format.map(|name| name.read(str::parse)).transpose()?;
        let format = Setting::of(flag(format, "--format", flags.format));
        let log =
            below.text(&file.log, "RMEM_LOG").map(|path| path.map(PathBuf::from).located(|path| folder.join(path)));
        let log = Setting::of(flag(log, "--log", flags.log.clone()));

        let histories = match &file.keep_history {
            Some(ages) => Setting { value: file.histories(), origin: below.place(ages) },
            None => Setting::default(Vec::new()),
        };
        let history_size = match &file.history_size {
            Some(size) => Setting { value: file.history_size(), origin: below.place(size) },
            None => Setting::default(history::DEFAULT_SIZE),
        };

        Ok(Self {
            memory,
            shared,
            shared_databases,
            collection,
            template_path,
            format,
            verbosity: verbosity(flags),
            color: color(flags, environment, terminal),
            log,
            load: flags.load.clone(),
            planners: file.planners(folder),
            backends: file.backends(folder),
            computables: file.computables(folder, below.path),
            histories,
            history_size,
            most_documents: file.most_documents(),
            object_kinds: file.object_kinds(),
            file: path,
        })
    }
}

/// Whether messages are in colour.
fn color(flags: &Flags, environment: &Environment, terminal: bool) -> bool {
    let set = |name| set(environment, name);
    match flags.color {
        Some(Color::Always) => true,
        Some(Color::Never) => false,
        Some(Color::Auto) | None => {
            terminal && set("NO_COLOR").is_none() && set("TERM").is_none_or(|term| term != "dumb")
        }
    }
}

fn verbosity(flags: &Flags) -> Verbosity {
    match (flags.quiet, flags.verbose) {
        (true, _) => Verbosity::Quiet,
        (false, true) => Verbosity::Verbose,
        (false, false) => Verbosity::Normal,
    }
}

fn names(names: &[toml::Spanned<String>]) -> Vec<String> {
    names.iter().map(|name| name.get_ref().clone()).collect()
}

/// Resolves a relative `file:` URI of a settings file against the folder of that file.
fn relative_uri(folder: &Path, uri: &str) -> String {
    match uri.strip_prefix("file:") {
        Some(path) if !path.is_empty() => format!("file:{}", folder.join(path).display()),
        _ => uri.to_owned(),
    }
}

/// Returns the URI of the embedded store in the user's data directory.
fn default_memory(environment: &Environment) -> Option<String> {
    let set = |name: &str| set(environment, name);
    let data = set("XDG_DATA_HOME")
        .map(PathBuf::from)
        .or_else(|| set("HOME").map(|home| Path::new(home).join(".local/share")))?;
    Some(format!("file:{}", data.join("rmem/memory.rmem").display()))
}

/// Returns the settings file that was named, else the nearest `rmem.toml` upwards, else the user's.
fn find_file(flags: &Flags, environment: &Environment, directory: &Path) -> Result<Option<PathBuf>> {
    let set = |name: &str| set(environment, name);
    if let Some(path) = flags.config.clone().or_else(|| set("RMEM_CONFIG").map(PathBuf::from)) {
        return Ok(Some(directory.join(path)));
    }
    let user = set("XDG_CONFIG_HOME")
        .map(PathBuf::from)
        .or_else(|| set("HOME").map(|home| Path::new(home).join(".config")))
        .map(|folder| folder.join("rmem/rmem.toml"));
    let upwards = directory.ancestors().map(|folder| folder.join("rmem.toml"));
    Ok(upwards.chain(user).find(|path| path.is_file()))
}

fn read_file(path: &Path) -> Result<File> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| unreadable(&format!("the settings {name}"), &error))?;
    Ok(File::parse(&decode(&name, bytes)?)?)
}
