//! Settings: defaults < `rmem.toml` < environment < flags, each value with its origin.
//!
//! [`Settings::resolve`] is the one place that layers them. Nothing is opened
//! or contacted here but the settings file itself.

pub mod backend;
mod computable;
pub mod file;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::ValueEnum as _;

use crate::cli::{Color, Global};
use crate::input::{UsageError, decode, unreadable};
use crate::memory::computables::Definition;
use crate::output::{Format, Verbosity};
use crate::planner::Configured;
use crate::store::Namespace;
use file::File;

/// The namespace where none is given.
const DEFAULT_COLLECTION: &str = "robmem.worldmodel";

/// The environment variables of a process, as a value.
pub type Environment = BTreeMap<String, String>;

/// Where a value came from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// Nobody said anything.
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

/// A value that remembers where it came from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Setting<T> {
    /// The value.
    pub value: T,
    /// Where it came from.
    pub origin: Origin,
}

impl<T> Setting<T> {
    fn default(value: T) -> Self {
        Self { value, origin: Origin::Default }
    }

    /// Lets a later layer win.
    fn layer(&mut self, value: Option<T>, origin: impl FnOnce() -> Origin) {
        if let Some(value) = value {
            *self = Self { value, origin: origin() };
        }
    }
}

/// Everything that is set before a command runs.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The settings file in use.
    pub file: Option<PathBuf>,
    /// URI of the local store; `None` where no data directory is known.
    pub memory: Setting<Option<String>>,
    /// URI of the store of shared databases; `None` is the local one.
    pub shared: Setting<Option<String>>,
    /// The databases that go to `shared`.
    pub shared_databases: Setting<Vec<String>>,
    /// The namespace where none is given.
    pub collection: Setting<Namespace>,
    /// How documents are printed; `None` leaves it to the command.
    pub format: Setting<Option<Format>>,
    /// How much is said.
    pub verbosity: Verbosity,
    /// Whether stderr is coloured.
    pub color: bool,
    /// The log of operations.
    pub log: Setting<Option<PathBuf>>,
    /// World files to load before the command.
    pub load: Vec<PathBuf>,
    /// Planners by configuration.
    pub planners: Vec<Configured>,
    /// Computables by configuration.
    pub computables: Vec<Definition>,
    /// The mongod processes of this robot.
    pub backends: Vec<backend::Backend>,
}

impl Settings {
    /// Layers defaults, settings file, environment and flags.
    ///
    /// # Errors
    /// A settings file that is missing, unreadable or wrong, with its position;
    /// a variable or flag whose value is not acceptable.
    pub fn resolve(
        flags: &Global,
        environment: &Environment,
        directory: &Path,
        terminal: bool,
    ) -> anyhow::Result<Self> {
        let garbled = |(name, value): &(&String, &String)| name.starts_with("RMEM_") && value.contains('\u{fffd}');
        if let Some((name, _)) = environment.iter().find(garbled) {
            return Err(UsageError::new(format!("the environment variable {name} is not UTF-8")).into());
        }
        let path = find_file(flags, environment, directory)?;
        let file = match &path {
            Some(path) => read_file(path)?,
            None => File::default(),
        };
        let folder = path.as_deref().and_then(Path::parent).unwrap_or(directory).to_owned();
        let at = |line: usize| {
            let path = path.clone().unwrap_or_default();
            move || Origin::File(path, line)
        };
        let variable = |name: &'static str| environment.get(name).filter(|value| !value.is_empty()).cloned();

        let mut memory = Setting::default(default_memory(environment));
        let mut shared = Setting::default(None);
        for (setting, in_file, name, flag, flag_name) in [
            (&mut memory, &file.memory, "RMEM_MEMORY", &flags.memory, "--memory"),
            (&mut shared, &file.shared, "RMEM_SHARED", &flags.shared, "--shared"),
        ] {
            if let Some(uri) = in_file {
                setting.layer(Some(Some(relative_uri(&folder, uri.get_ref()))), at(file.line(uri.span())));
            }
            setting.layer(variable(name).map(Some), || Origin::Environment(name));
            setting.layer(flag.clone().map(Some), || Origin::Flag(flag_name));
        }

        let mut shared_databases = Setting::default(Vec::new());
        if let Some(databases) = &file.shared_databases {
            shared_databases.layer(Some(names(databases.get_ref())), at(file.line(databases.span())));
        }

        let mut collection = Setting::default(DEFAULT_COLLECTION.to_owned());
        if let Some(name) = &file.collection {
            collection.layer(Some(name.get_ref().clone()), at(file.line(name.span())));
        }
        collection.layer(variable("RMEM_COLLECTION"), || Origin::Environment("RMEM_COLLECTION"));
        collection.layer(flags.collection.clone(), || Origin::Flag("--collection"));
        let collection = Setting {
            value: collection.value.parse().with_context(|| format!("set by {}", collection.origin))?,
            origin: collection.origin,
        };

        let mut format = Setting::default(None);
        if let Some(name) = &file.format {
            format.layer(Some(Some(parse_format(name.get_ref())?)), at(file.line(name.span())));
        }
        if let Some(name) = variable("RMEM_FORMAT") {
            let format_of = parse_format(&name).context("set by the environment variable RMEM_FORMAT")?;
            format.layer(Some(Some(format_of)), || Origin::Environment("RMEM_FORMAT"));
        }
        format.layer(flags.format.map(Some), || Origin::Flag("--format"));

        let mut log = Setting::default(None);
        if let Some(name) = &file.log {
            log.layer(Some(Some(folder.join(name.get_ref()))), at(file.line(name.span())));
        }
        log.layer(variable("RMEM_LOG").map(|path| Some(path.into())), || Origin::Environment("RMEM_LOG"));
        log.layer(flags.log.clone().map(Some), || Origin::Flag("--log"));

        let color = match flags.color {
            Some(Color::Always) => true,
            Some(Color::Never) => false,
            Some(Color::Auto) | None => {
                terminal && variable("NO_COLOR").is_none() && variable("TERM").is_none_or(|term| term != "dumb")
            }
        };
        let verbosity = match (flags.quiet, flags.verbose) {
            (true, _) => Verbosity::Quiet,
            (false, true) => Verbosity::Verbose,
            (false, false) => Verbosity::Normal,
        };
        Ok(Self {
            memory,
            shared,
            shared_databases,
            collection,
            format,
            verbosity,
            color,
            log,
            load: flags.load.clone(),
            planners: file.planners(&folder),
            backends: file.backends(&folder),
            computables: file.computables(&folder),
            file: path,
        })
    }
}

fn names(names: &[toml::Spanned<String>]) -> Vec<String> {
    names.iter().map(|name| name.get_ref().clone()).collect()
}

fn parse_format(name: &str) -> Result<Format, UsageError> {
    Format::from_str(name, false).map_err(|_| {
        let known: Vec<_> = Format::value_variants().iter().map(|format| format.name()).collect();
        UsageError::new(format!("unknown format `{name}`; expected one of {}", known.join(", ")))
    })
}

/// A relative `file:` URI of a settings file is relative to that file's folder.
fn relative_uri(folder: &Path, uri: &str) -> String {
    match uri.strip_prefix("file:") {
        Some(path) if !path.is_empty() => format!("file:{}", folder.join(path).display()),
        _ => uri.to_owned(),
    }
}

/// The embedded store in the user's data directory.
fn default_memory(environment: &Environment) -> Option<String> {
    let set = |name: &str| environment.get(name).filter(|value| !value.is_empty());
    let data = set("XDG_DATA_HOME")
        .map(PathBuf::from)
        .or_else(|| set("HOME").map(|home| Path::new(home).join(".local/share")))?;
    Some(format!("file:{}", data.join("rmem/memory.rmem").display()))
}

/// The file that was named, else the nearest `rmem.toml` upwards, else the user's.
fn find_file(flags: &Global, environment: &Environment, directory: &Path) -> anyhow::Result<Option<PathBuf>> {
    let set = |name: &str| environment.get(name).filter(|value| !value.is_empty());
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

fn read_file(path: &Path) -> anyhow::Result<File> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| unreadable(&format!("the settings {name}"), &error))?;
    Ok(File::parse(&decode(&name, bytes)?)?)
}
