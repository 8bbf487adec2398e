//! What a run may use, and its limits.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// What runs need from the calling process. The library reads no environment.
#[derive(Debug, Clone)]
pub struct Host<'a> {
    /// The rmem executable: it starts itself again as `__supervisor` and as `ff`.
    pub exe: PathBuf,
    /// Where temporary directories are made.
    pub temporary: PathBuf,
    /// Becomes true on Ctrl-C; the run then stops with nothing left behind.
    pub interrupted: &'a AtomicBool,
}

impl Host<'_> {
    /// Whether the run has to stop.
    #[must_use]
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }
}

/// The limits of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Wall time.
    pub time: Option<Duration>,
    /// Address space of each process of the program, and what all of them together may have
    /// resident, in bytes.
    pub memory: Option<u64>,
    /// What it may print on one stream, in bytes; a program that prints more is stopped.
    pub output: u64,
}

impl Default for Limits {
    /// 60 s, no limit of memory, 64 MiB of output.
    fn default() -> Self {
        Self { time: Some(Duration::from_secs(60)), memory: None, output: 64 << 20 }
    }
}
