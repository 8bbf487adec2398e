//! What does not fit in memory: sorts and groups go on in temporary files, as with mongod's `allowDiskUse`.
//!
//! The files have no names, so that nothing is left behind by a process that is killed.

mod blocks;
mod file;
mod runs;
mod sorter;
mod spool;

use std::path::PathBuf;

pub(super) use blocks::{BlockWriter, Blocks};
pub(super) use file::{Keeper, Kept};
pub(super) use runs::Runs;
pub(super) use sorter::Sorter;
pub use spool::Spool;

/// The bytes that one sort or `$group` holds in memory. mongod's limit is 100 MB; this leaves room for a second stage,
/// which reads what the first gives, and for the rest of the process.
const LIMIT: usize = 48 << 20;

/// How much memory an operation may hold, and where it goes on when that is not enough.
#[derive(Debug, Clone)]
pub struct Spill {
    /// The bytes it may hold.
    pub limit: usize,
    /// The folder of its temporary files.
    pub folder: PathBuf,
}

impl Default for Spill {
    /// Returns the usual limit, and the system's folder of temporary files.
    fn default() -> Self {
        Self { limit: LIMIT, folder: std::env::temp_dir() }
    }
}
