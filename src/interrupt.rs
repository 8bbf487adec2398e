//! Ctrl-C: ends the process at once, unless something has to be cleaned up first.

use std::cell::Cell;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Whether the user interrupted the process.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// How many guards there are.
static GUARDS: AtomicUsize = AtomicUsize::new(0);

/// How often the removal of a folder is tried.
const REMOVALS: usize = 100;

/// Files and folders that are not finished.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

thread_local! {
    /// How many guards there are under which long work of stores in this thread ends early where the user interrupts it.
    static STOPPING: Cell<usize> = const { Cell::new(0) };
}

/// Whether long work in this thread is to end now, with what is done.
pub(crate) fn stops_work() -> bool {
    STOPPING.get() > 0 && INTERRUPTED.load(Ordering::SeqCst)
}

/// Notes an interruption. Returns whether the process should end at once: it should not while a guard lives,
/// unless the user interrupts again. Where it should, unfinished files are removed.
pub fn received() -> bool {
    let again = INTERRUPTED.swap(true, Ordering::SeqCst);
    let ends = again || GUARDS.load(Ordering::SeqCst) == 0;
    if ends {
        // One that has taken the place of its target by now is not there any more.
        let files = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        files.iter().for_each(|path| remove(path));
        // Until the process has ended, no thread makes another one.
        std::mem::forget(files);
    }
    ends
}

/// Removes a file, or a folder with what is in it; another thread may write into it meanwhile.
fn remove(path: &Path) {
    for _ in 0..REMOVALS {
        if fs::remove_file(path).or_else(|_| fs::remove_dir_all(path)).is_ok() || fs::symlink_metadata(path).is_err() {
            return;
        }
    }
}

fn unfinished<T>(work: impl FnOnce(&mut Vec<PathBuf>) -> T) -> T {
    work(&mut UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner))
}

/// While it lives, an interruption that ends the process removes its files, and its folders.
#[derive(Debug)]
pub(crate) struct Unfinished(Vec<PathBuf>);

impl Unfinished {
    /// Makes something that has these paths; no interruption ends the process between that and their being known.
    ///
    /// # Errors
    /// Where it cannot be made.
    pub(crate) fn making<T, E>(
        make: impl FnOnce() -> Result<T, E>,
        paths: impl FnOnce(&T) -> Vec<PathBuf>,
    ) -> Result<(T, Self), E> {
        unfinished(|files| {
            let made = make()?;
            let paths = paths(&made);
            files.extend_from_slice(&paths);
            Ok((made, Self(paths)))
        })
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        unfinished(|files| files.retain(|path| !self.0.contains(path)));
    }
}

/// While it lives, an interruption only sets a flag; its holder looks at the flag, cleans up and ends.
#[derive(Debug)]
pub(crate) struct InterruptGuard {
    /// Whether stores look at the flag.
    is_stopping: bool,
}

impl InterruptGuard {
    pub(crate) fn new() -> Self {
        GUARDS.fetch_add(1, Ordering::SeqCst);
        Self { is_stopping: false }
    }

    /// A guard under which stores look at the flag: in this thread, a change of many documents ends early.
    pub(crate) fn stopping() -> Self {
        STOPPING.set(STOPPING.get() + 1);
        let mut guard = Self::new();
        guard.is_stopping = true;
        guard
    }

    /// Ends the guard where the flag is not looked at any more. An interruption that came meanwhile is sent
    /// again, unless another guard lives.
    pub(crate) fn end(self) {
        drop(self);
        if INTERRUPTED.load(Ordering::SeqCst) && GUARDS.load(Ordering::SeqCst) == 0 {
            // Where it cannot be sent, the user will interrupt once more.
            let _ = rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::INT);
        }
    }

    /// The flag that [`received`] sets.
    pub(crate) fn interrupted(&self) -> &'static AtomicBool {
        &INTERRUPTED
    }
}

impl Drop for InterruptGuard {
    fn drop(&mut self) {
        if self.is_stopping {
            STOPPING.set(STOPPING.get().saturating_sub(1));
        }
        GUARDS.fetch_sub(1, Ordering::SeqCst);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stores_look_at_the_flag_as_long_as_a_guard_says_so() {
        let (first, second) = (InterruptGuard::stopping(), InterruptGuard::stopping());
        drop(InterruptGuard::new());
        drop(second);
        assert_eq!(STOPPING.get(), 1);
        drop(first);
        assert_eq!(STOPPING.get(), 0);
    }
}
