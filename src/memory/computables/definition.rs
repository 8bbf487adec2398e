//! What a computable is by configuration.

use std::path::PathBuf;
use std::time::Duration;

use bson::Document;

use super::body::{Body, Options};
use super::builtin::BUILTINS;
use super::command::Command;
use super::pipeline::Pipeline;
use crate::process::Host;
use crate::query::QueryError;
use crate::store::Namespace;

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

    /// The body of a computable of a namespace, on this host.
    ///
    /// # Errors
    /// Where there is no such builtin, or it does not accept an option.
    pub(super) fn body(&self, ns: &Namespace, host: &Host<'static>) -> Result<Box<dyn Body>, QueryError> {
        Ok(match self.clone() {
            Self::Pipeline { from, stages } => Box::new(Pipeline { from, stages }),
            Self::Command { words, folder, timeout } => {
                Box::new(Command { words, folder, timeout, host: host.clone() })
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
