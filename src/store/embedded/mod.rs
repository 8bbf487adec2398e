//! The embedded store: a durable file of this machine, no server.
//!
//! Documents are kept as BSON in an SQLite database, one table per collection,
//! and are matched without decoding them. Several processes use one file at
//! the same time: writers take turns (see `timeout`), readers never wait for
//! writers. A write is on the disk when it returns.

mod access;
mod answer;
mod batch;
mod busy;
mod catalog;
mod change;
mod expiry;
mod failure;
mod feed;
mod file;
mod index;
mod log;
mod moment;
mod near;
mod notifier;
mod output;
mod pipeline;
mod scan;
mod verbs;
mod watcher;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rusqlite::Connection;

pub use file::VERSION;

/// A memory in a file, or in this process only.
///
/// Closing (dropping) the last store that has a file open folds its
/// write-ahead log into the file.
pub struct Embedded {
    connection: Connection,
    place: Place,
    indexes: index::Remembered,
    log: log::Log,
    /// Whether it waits for other writers only briefly, at the moment.
    hurried: Arc<AtomicBool>,
}

/// Where an embedded store lives; its `Display` is what messages call it.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Place {
    File(PathBuf),
    Memory,
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::File(path) => write!(f, "file:{}", path.display()),
            Self::Memory => f.write_str("mem:"),
        }
    }
}
