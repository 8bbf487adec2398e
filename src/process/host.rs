//! What a run may use, and its limits.

use std::fmt;
use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How many bytes of what a program printed its listener gets.
const TAIL: u64 = 4096;

/// What runs need from the calling process. The library reads no environment; only the supervisor, a process of its
/// own, reads its `PATH`, to explain why a program did not start.
#[derive(Debug, Clone)]
pub struct Host<'a> {
    /// The rmem executable: it starts itself again as `__supervisor` and as `ff`.
    pub exe: PathBuf,
    /// Where temporary directories are made.
    pub temporary: PathBuf,
    /// Becomes true on Ctrl-C; the run then stops with nothing left behind.
    pub interrupted: &'a AtomicBool,
    /// Gets what programs print while they run.
    pub listener: Listener,
}

/// The receiver of the last part of a running program's output, several times a second; none by default.
#[derive(Clone, Default)]
pub struct Listener(Option<Arc<Listen>>);

/// A function that gets text.
type Listen = dyn Fn(&str) + Send + Sync;

impl Listener {
    /// A listener.
    pub fn new(listen: impl Fn(&str) + Send + Sync + 'static) -> Self {
        Self(Some(Arc::new(listen)))
    }

    /// Passes on the end of a file that a program writes.
    pub(super) fn receive(&self, path: &Path) {
        let Some(listen) = &self.0 else { return };
        // What cannot be read now is read the next time.
        if let Ok(text) = end_of(path) {
            listen(&text);
        }
    }
}

impl fmt::Debug for Listener {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Listener({})", self.0.is_some())
    }
}

/// The last part of a file, as text.
fn end_of(path: &Path) -> io::Result<String> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
    let mut bytes = Vec::new();
    file.take(TAIL).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
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
