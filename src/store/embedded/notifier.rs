//! Waking those who wait for changes, at once and without asking again and again.
//!
//! Whoever has committed changes that are watched sets the file's times to now; on
//! Linux, the kernel tells that to those who wait (inotify). A call that is not heard,
//! because its process was killed just then, costs a moment: nobody waits longer than
//! [`LONGEST`] without looking. Elsewhere, one looks every [`LONGEST`].

use std::path::Path;
use std::time::Duration;

/// How long somebody waits without looking.
#[cfg(target_os = "linux")]
const LONGEST: Duration = Duration::from_millis(500);
#[cfg(not(target_os = "linux"))]
const LONGEST: Duration = Duration::from_millis(20);

/// Calls all who wait for changes of the file.
pub(super) fn call(path: &Path) {
    use rustix::fs::{AtFlags, CWD, Timespec, Timestamps, UTIME_NOW, utimensat};
    let now = Timespec { tv_sec: 0, tv_nsec: UTIME_NOW };
    // Who is not called looks by itself, a moment later.
    let _ = utimensat(CWD, path, &Timestamps { last_access: now, last_modification: now }, AtFlags::empty());
}

/// Hears the calls, from when it is made on.
pub(super) struct Notifier {
    #[cfg(target_os = "linux")]
    calls: Option<rustix::fd::OwnedFd>,
}

#[cfg(target_os = "linux")]
impl Notifier {
    pub(super) fn new(path: &Path) -> Self {
        use rustix::fs::inotify::{CreateFlags, WatchFlags, add_watch, init};
        // Where the system has no more of them to give, one looks from time to time.
        let calls = init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC).ok();
        let calls = calls.filter(|calls| add_watch(calls, path, WatchFlags::ATTRIB).is_ok());
        Self { calls }
    }

    /// Waits for a call, for at most `timeout`.
    pub(super) fn wait(&self, timeout: Duration) {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let Some(calls) = &self.calls else { return std::thread::sleep(timeout.min(LONGEST / 25)) };
        let Ok(timeout) = Timespec::try_from(timeout.min(LONGEST)) else { return };
        // An interrupted wait is over, as one that heard something.
        let _ = poll(&mut [PollFd::new(calls, PollFlags::IN)], Some(&timeout));
        while rustix::io::read(calls, &mut [0_u8; 4096]).is_ok_and(|count| count > 0) {}
    }
}

#[cfg(not(target_os = "linux"))]
impl Notifier {
    pub(super) fn new(_: &Path) -> Self {
        Self {}
    }

    /// Waits a little.
    pub(super) fn wait(&self, timeout: Duration) {
        std::thread::sleep(timeout.min(LONGEST));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn a_call_before_the_wait_is_heard() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let notifier = Notifier::new(file.path());
        call(file.path());
        let start = Instant::now();
        notifier.wait(Duration::from_secs(3600));
        assert!(start.elapsed() < Duration::from_secs(3600));
        assert!(notifier.calls.is_some());
        let calls = notifier.calls.as_ref().unwrap();
        assert!(rustix::io::read(calls, &mut [0_u8; 64]).is_err(), "what was heard is heard once");
    }
}
