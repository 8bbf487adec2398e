//! Notifying watchers of changes without polling.
//!
//! A process that has committed watched changes sets the file's times to now; on Linux, the
//! kernel notifies the waiting processes (inotify). If a process is killed before it notifies,
//! the delay is bounded: watchers look at the file at least every [`MAX_WAIT`]. On other
//! systems they poll at that interval.

use std::path::Path;
use std::time::Duration;

/// The longest wait without looking at the file: changes of a process that was killed before it notified are seen by then.
#[cfg(target_os = "linux")]
const MAX_WAIT: Duration = Duration::from_millis(500);
#[cfg(not(target_os = "linux"))]
const MAX_WAIT: Duration = Duration::from_millis(20);

/// Notifies all watchers of the file.
pub(super) fn notify(path: &Path) {
    use rustix::fs::{AtFlags, CWD, Timespec, Timestamps, UTIME_NOW, utimensat};
    let now = Timespec { tv_sec: 0, tv_nsec: UTIME_NOW };
    // Watchers that are not notified look at the file by themselves, a moment later.
    let _ = utimensat(CWD, path, &Timestamps { last_access: now, last_modification: now }, AtFlags::empty());
}

/// Receives notifications from its creation on.
pub(crate) struct Notifier {
    #[cfg(target_os = "linux")]
    calls: Option<rustix::fd::OwnedFd>,
}

#[cfg(target_os = "linux")]
impl Notifier {
    pub(crate) fn new(path: &Path) -> Self {
        use rustix::fs::inotify::{CreateFlags, WatchFlags, add_watch, init};
        // Where the system is out of inotify instances, the watcher polls.
        let calls = init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC).ok();
        let calls = calls.filter(|calls| add_watch(calls, path, WatchFlags::ATTRIB).is_ok());
        Self { calls }
    }

    /// Waits for a notification, for at most `timeout`.
    pub(crate) fn wait(&self, timeout: Duration) {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let Some(calls) = &self.calls else { return std::thread::sleep(timeout.min(MAX_WAIT / 25)) };
        let Ok(timeout) = Timespec::try_from(timeout.min(MAX_WAIT)) else { return };
        // An interrupted wait ends as if a notification had come.
        let _ = poll(&mut [PollFd::new(calls, PollFlags::IN)], Some(&timeout));
        while rustix::io::read(calls, &mut [0_u8; 4096]).is_ok_and(|count| count > 0) {}
    }
}

#[cfg(not(target_os = "linux"))]
impl Notifier {
    pub(crate) fn new(_: &Path) -> Self {
        Self {}
    }

    /// Waits a little.
    pub(crate) fn wait(&self, timeout: Duration) {
        std::thread::sleep(timeout.min(MAX_WAIT));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn a_notification_before_the_wait_is_received() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let notifier = Notifier::new(file.path());
        notify(file.path());
        let start = Instant::now();
        notifier.wait(Duration::from_secs(3600));
        assert!(start.elapsed() < Duration::from_secs(3600));
        assert!(notifier.calls.is_some());
        let calls = notifier.calls.as_ref().unwrap();
        assert!(rustix::io::read(calls, &mut [0_u8; 64]).is_err(), "a notification is received once");
    }
}
