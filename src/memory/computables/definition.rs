//! What a computable is by configuration.

use std::path::PathBuf;
use std::time::Duration;

use bson::Document;

use super::body::Body;
use super::command::Command;
use super::nearest::Nearest;
use super::pipeline::Pipeline;
use super::transform::Transform;
use crate::process::Host;
use crate::store::Namespace;

/// The names of rmem's own bodies.
pub const BUILTINS: [&str; 2] = ["transform", "nearest"];

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
    /// Poses in another frame.
    Transform {
        /// The tree of frames: documents `{frame, parent, translation, rotation}`.
        frames: Namespace,
    },
    /// Documents by distance.
    Nearest {
        /// The (dotted) key of a document's position.
        position: String,
    },
}

impl BodyKind {
    /// The body, at work on this host.
    pub(super) fn body(&self, host: &Host<'static>) -> Box<dyn Body> {
        match self.clone() {
            Self::Pipeline { from, stages } => Box::new(Pipeline { from, stages }),
            Self::Command { words, folder, timeout } => {
                Box::new(Command { words, folder, timeout, host: host.clone() })
            }
            Self::Transform { frames } => Box::new(Transform { frames }),
            Self::Nearest { position } => Box::new(Nearest { position }),
        }
    }
}
