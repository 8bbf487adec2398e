//! What a computable is by configuration.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use bson::Document;

use super::body::{Body, Options};
use super::builtin::BUILTINS;
use super::command::Command;
use super::pipeline::Pipeline;
use crate::process::Host;
use crate::query::QueryError;
use crate::store::{Namespace, metadata};

/// Where a computable is declared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// In a settings file, or by a program: the place, like `rmem.toml:3`.
    Settings(String),
    /// In the memory: the collection that has it.
    Memory(Namespace),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Settings(place) => write!(f, "{place}"),
            Self::Memory(namespace) => write!(f, "{namespace}"),
        }
    }
}

impl Origin {
    /// Returns the origin of what a program itself declares.
    #[must_use]
    pub fn program() -> Self {
        Self::Settings("this program".to_owned())
    }
}

/// Why a program is not kept in a memory.
pub const NO_PROGRAMS: &str = "a program is declared in a settings file only: others write to the memory, and what \
they write must not run programs here";

/// A computable, as `[[computable]]` in `rmem.toml` declares it.
#[derive(Debug, Clone, PartialEq)]
pub struct Definition {
    /// What messages call it; no other of the same memory has this name.
    pub name: String,
    /// The namespace that it computes documents of.
    pub namespace: Namespace,
    /// The query that asked queries are matched against, as documents.
    pub spec: Document,
    /// Higher runs first; of equal ones, the later registered.
    pub priority: i64,
    /// How long its documents are good for equal queries; without, for one query.
    pub cache: Option<Duration>,
    /// Where it adds keys to stored documents instead of giving documents: the keys that a query may ask for. `None` where
    /// it gives documents.
    pub adds: Option<Vec<String>>,
    /// What computes.
    pub body: BodyKind,
    /// Where it is declared.
    pub origin: Origin,
}

/// Returns what is wrong with the names of keys that a computable adds.
///
/// # Errors
/// Where there is none, or one cannot be added.
pub fn check_adds(keys: &[String]) -> Result<(), String> {
    if keys.is_empty() {
        return Err("expected the keys that it adds, found none; `true` stands for any".to_owned());
    }
    for (at, key) in keys.iter().enumerate() {
        let why = if key == "_id" {
            "`_id` says which document gets the keys, and cannot be added"
        } else if key == metadata::INFO {
            "this key holds rmem's metadata, and cannot be added"
        } else if key.is_empty() || key.starts_with('$') || key.contains('.') {
            "expected a key of the document itself, without `.` and `$`"
        } else if keys.iter().take(at).any(|other| other == key) {
            "it is given twice"
        } else {
            continue;
        };
        return Err(format!("`{key}`: {why}"));
    }
    Ok(())
}

/// The kinds of bodies.
#[derive(Debug, Clone, PartialEq)]
pub enum BodyKind {
    /// An aggregation.
    Pipeline {
        /// Over this collection.
        from: Namespace,
        /// Its stages.
        stages: Vec<Document>,
    },
    /// A program: the query as a line of JSON on stdin, documents as JSON lines on stdout.
    Command {
        /// Program and arguments; no shell.
        words: Vec<String>,
        /// Where it runs.
        folder: PathBuf,
        /// How long it may take.
        timeout: Duration,
    },
    /// One of [`super::BUILTINS`].
    Builtin {
        /// Its name.
        name: String,
        /// Its options.
        options: Options,
    },
}

impl BodyKind {
    /// A builtin body with options.
    #[must_use]
    pub fn builtin<'a>(name: &str, options: impl IntoIterator<Item = (&'a str, String)>) -> Self {
        let options = options.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        Self::Builtin { name: name.to_owned(), options }
    }

    /// The body of a computable of a namespace. Programs run on `host`; without one, there are none.
    ///
    /// # Errors
    /// Where there is no such builtin, or it does not accept an option.
    pub(super) fn body(&self, ns: &Namespace, host: Option<&Host<'static>>) -> Result<Box<dyn Body>, QueryError> {
        Ok(match self.clone() {
            Self::Pipeline { from, stages } => Box::new(Pipeline { from, stages }),
            Self::Command { words, folder, timeout } => {
                let host = host.ok_or_else(|| QueryError::bad_value(NO_PROGRAMS))?.clone();
                Box::new(Command { words, folder, timeout, host })
            }
            Self::Builtin { name, options } => {
                let builtin = BUILTINS.iter().find(|builtin| builtin.name == name);
                let builtin = builtin.ok_or_else(|| QueryError::bad_value(format!("there is no builtin `{name}`")))?;
                (builtin.make)(&options, ns)
                    .map_err(|(key, wrong)| QueryError::bad_value(format!("its `{key}` is wrong: {wrong}")))?
            }
        })
    }
}
