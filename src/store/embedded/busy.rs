//! Waiting for another process to finish its write.
//!
//! SQLite's own busy handler sleeps in steps that grow to 100 ms, so a writer
//! among writers stalls for much longer than any write takes. This one starts
//! with a fraction of a write's duration and never sleeps longer than
//! [`MAX_BACKOFF`]; random jitter keeps two waiting processes from retrying at the same times.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant, SystemTime};

use rusqlite::Connection;

/// How long a write waits for the locks of other processes.
pub(super) const LOCK_TIMEOUT: Duration = Duration::from_secs(30);
/// The same for best-effort writes, which are repeated later.
const BRIEF_TIMEOUT: Duration = Duration::from_millis(4);
/// The wait after which the user is told that another process writes.
const NOTICE_DELAY: Duration = Duration::from_secs(2);
const MIN_BACKOFF: Duration = Duration::from_micros(100);
const MAX_BACKOFF: Duration = Duration::from_millis(8);

/// What is called once a write has waited for long.
static TELL: OnceLock<fn(&str)> = OnceLock::new();
/// What it is called with.
const WAITING: &str = "another process writes to the memory; waiting until it is done";

/// Calls `tell` with a message for each write of this process that has waited two seconds for another process, once.
/// The first call of this function counts.
pub fn tell_waits(tell: fn(&str)) {
    let _ = TELL.set(tell);
}

/// Makes `connection` wait for locks of other processes: for [`LOCK_TIMEOUT`], and longer as long as
/// the log at `log` is written; while `is_brief` is set, for [`BRIEF_TIMEOUT`].
pub(super) fn install(
    connection: &mut Connection,
    is_brief: Arc<AtomicBool>,
    log: Option<PathBuf>,
) -> rusqlite::Result<()> {
    let (mut since, mut progress) = (Instant::now(), Progress { log, state: None });
    let mut is_told = false;
    connection.busy_handler(Some(move |attempt: i32| {
        if attempt == 0 {
            since = Instant::now();
            progress.begin();
            is_told = false;
        }
        if !is_told && since.elapsed() >= NOTICE_DELAY {
            is_told = true;
            TELL.get().into_iter().for_each(|tell| tell(WAITING));
        }
        let has_time = !is_brief.load(Ordering::Relaxed) || since.elapsed() < BRIEF_TIMEOUT;
        if since.elapsed() >= LOCK_TIMEOUT && progress.is_made() {
            since = Instant::now();
        }
        has_time && wait(since, attempt.unsigned_abs())
    }))
}

/// The progress of the process that holds the lock: a long write writes to the log. It may write over what is there,
/// so that the log does not grow.
struct Progress {
    log: Option<PathBuf>,
    state: Option<LogState>,
}

/// The length of a log, and when it was written.
type LogState = (u64, Option<SystemTime>);

impl Progress {
    /// Notes the log as it is when a wait begins.
    fn begin(&mut self) {
        self.state = self.current();
    }

    /// Whether the log has changed since the wait began, or the last call.
    fn is_made(&mut self) -> bool {
        let state = self.current();
        std::mem::replace(&mut self.state, state) != state
    }

    fn current(&self) -> Option<LogState> {
        let log = std::fs::metadata(self.log.as_ref()?).ok()?;
        Some((log.len(), log.modified().ok()))
    }
}

/// Repeats `attempt` while another process holds the lock, for at most [`LOCK_TIMEOUT`].
///
/// For the few statements for which SQLite calls no busy handler, such as the
/// change of the journal mode.
pub(super) fn retry<T>(mut attempt: impl FnMut() -> rusqlite::Result<T>) -> rusqlite::Result<T> {
    let since = Instant::now();
    let mut attempts = 0;
    loop {
        match attempt() {
            Err(error) if is_busy(&error) && wait(since, attempts) => attempts += 1,
            result => return result,
        }
    }
}

/// Whether another process holds the lock.
pub(super) fn is_busy(error: &rusqlite::Error) -> bool {
    use rusqlite::ErrorCode::{DatabaseBusy, DatabaseLocked};
    matches!(error.sqlite_error_code(), Some(DatabaseBusy | DatabaseLocked))
}

/// Sleeps before the next attempt; returns false after [`LOCK_TIMEOUT`].
fn wait(since: Instant, attempt: u32) -> bool {
    let waited = since.elapsed();
    if waited >= LOCK_TIMEOUT {
        return false;
    }
    let step = MIN_BACKOFF.saturating_mul(1 << attempt.min(10)).min(MAX_BACKOFF);
    std::thread::sleep(step.mul_f64(0.5 + jitter(waited)));
    true
}

/// A pseudo-random number below 1, from the clock and the process id.
fn jitter(waited: Duration) -> f64 {
    let noise = waited.subsec_nanos() ^ std::process::id().wrapping_mul(0x9E37_79B9);
    f64::from(noise.wrapping_mul(0x85EB_CA6B) >> 16) / f64::from(1 << 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jitter_lies_between_nothing_and_one() {
        for nanos in [0, 1, 999, 123_456_789] {
            let jitter = jitter(Duration::from_nanos(nanos));
            assert!((0.0..1.0).contains(&jitter), "{jitter}");
        }
    }

    #[test]
    fn a_log_that_is_written_over_is_progress() {
        let log = tempfile::NamedTempFile::new().unwrap();
        let mut progress = Progress { log: Some(log.path().to_owned()), state: None };
        progress.begin();
        assert!(!progress.is_made());
        log.as_file().set_modified(SystemTime::UNIX_EPOCH).unwrap();
        assert!(progress.is_made());
        log.as_file().set_len(10).unwrap();
        assert!(progress.is_made());
        // What was written between two waits is not progress of the second.
        log.as_file().set_len(20).unwrap();
        progress.begin();
        assert!(!progress.is_made());
    }

    #[test]
    fn gives_up_after_the_lock_timeout() {
        let Some(long_ago) = Instant::now().checked_sub(LOCK_TIMEOUT) else { return };
        assert!(!wait(long_ago, 3));
        assert!(wait(Instant::now(), 3));
    }
}
