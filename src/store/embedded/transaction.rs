//! What a write transaction knows of the log of changes.

use std::cell::{Cell, RefCell};

use super::history::{Keeping, Kept};
use crate::store::Namespace;

/// What is watched, and which histories are kept.
pub(super) struct Watched {
    /// The watched collections.
    pub(super) watches: Vec<Namespace>,
    /// What changes are kept of for change streams, with empty names for all.
    pub(super) streams: Vec<Namespace>,
    pub(super) histories: Vec<Kept>,
}

/// The state of the log in the current write transaction.
#[derive(Default)]
pub(super) struct Log {
    /// What is watched, read once per transaction.
    pub(super) watched: RefCell<Option<Watched>>,
    /// Whether a change was appended.
    pub(super) noted: Cell<bool>,
    /// The position of the first of them.
    pub(super) first: Cell<i64>,
    /// The position of the last of them.
    pub(super) last: Cell<i64>,
    /// The positions of the first and the last of those that were committed last.
    pub(super) committed: Cell<Option<(i64, i64)>>,
    /// The histories that this process keeps.
    pub(super) keeping: Keeping,
}
