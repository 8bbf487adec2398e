//! The embedded store: a file on this machine, without a server.
//!
//! Documents are kept as BSON in an SQLite database, one table per collection,
//! and are matched without decoding them. Several processes use one file at
//! the same time: writers wait for each other (see `busy`), readers never wait for
//! writers. A write is on the disk when it returns.

mod access;
mod ahead;
mod answer;
mod backup;
mod batch;
mod body;
mod busy;
mod catalog;
mod catalog_cache;
mod change;
mod change_log;
mod check;
mod damage;
mod damaged_table;
mod disk_space;
mod expiry;
mod failure;
mod feed;
mod file;
mod find_and_modify;
mod history;
mod index;
mod indexed;
mod keys;
mod keys_read;
mod log;
mod log_size;
mod near;
mod new_file;
mod notifier;
mod opened;
mod output;
mod page;
mod past;
mod pipeline;
mod place;
mod repair;
mod retention;
mod rolled_back;
mod scan;
mod search;
mod slices;
mod snapshot;
mod spare;
mod staged;
mod statistics;
mod transaction;
mod unconstrained;
mod validating;
mod validation;
mod verbs;
mod watcher;

use std::cell::{Cell, RefCell};
use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use rusqlite::Connection;

use catalog_cache::CatalogCache;
use indexed::Remembered;
use log_size::LogSize;
use place::Place;
use rolled_back::RolledBack;
use spare::Spare;
use transaction::Log;

use crate::store::{FileIdentity, Warn};

pub use busy::tell_waits;
pub use file::VERSION;
#[cfg(feature = "serve")]
pub(crate) use notifier::Notifier;
pub use repair::Repaired;

/// A memory in a file, or in this process only.
///
/// Closing (dropping) the last store that has a file open folds its
/// write-ahead log into the file.
pub struct Embedded {
    connection: Connection,
    place: Place,
    /// Which file it is; none where no other connection may open it.
    identity: Option<FileIdentity>,
    indexes: Remembered,
    catalog_cache: CatalogCache,
    log: Log,
    rolled_back: RolledBack,
    /// Whether a write waits only briefly for other writers.
    is_brief: Arc<AtomicBool>,
    /// Whether what is read is of one moment, so that nothing is written.
    is_reading: Cell<bool>,
    /// Until when documents may be read, where that is limited.
    reads_until: Cell<Option<Instant>>,
    /// Whether documents are stored that do not pass the validator of their collection.
    is_bypassing: Cell<bool>,
    /// The collections, by number, that have been found to have all documents that their index of `_id`s names.
    whole: RefCell<HashSet<i64>>,
    /// Takes warnings.
    warn: RefCell<Option<Warn>>,
    /// Whether what is written makes room.
    is_deleting: Cell<bool>,
    /// Whether the disk was nearly full when something was written last, or nothing was written yet.
    is_crowded: Cell<bool>,
    log_size: LogSize,
    spare: Spare<Embedded>,
}
