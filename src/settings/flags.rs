//! What the command line says about settings, as plain values.

use std::path::PathBuf;

use clap::ValueEnum;

use crate::output::Format;

/// The global flags that were given.
#[derive(Debug, Clone, Default)]
pub struct Flags {
    /// `--memory`: URI of the local store.
    pub memory: Option<String>,
    /// `--shared`: URI of the store of shared databases.
    pub shared: Option<String>,
    /// `--config`: the settings file.
    pub config: Option<PathBuf>,
    /// `--load`: world files to load before the command.
    pub load: Vec<PathBuf>,
    /// `--format`: how results are printed.
    pub format: Option<Format>,
    /// `--collection`: the default namespace.
    pub collection: Option<String>,
    /// `-q`: print errors only.
    pub quiet: bool,
    /// `-v`: print each operation.
    pub verbose: bool,
    /// `--color`: when to colour messages.
    pub color: Option<Color>,
    /// `--log`: the log of operations.
    pub log: Option<PathBuf>,
}

/// When messages are coloured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Color {
    /// On a terminal.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}
