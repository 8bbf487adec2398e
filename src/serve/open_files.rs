//! Where the process may open no more files: connections that have ended give theirs back.
//!
//! A connection that has ended keeps its cursors for other connections, and with them the files by which they are read.

use std::fs::File;
use std::time::{Duration, Instant};

use super::server::Server;

/// What opens a file each time.
const ANY_FILE: &str = "/dev/null";
/// A memory opens so many files: its own, the log, and the index of the log.
const NEEDED: usize = 3;
/// How long a thread has to close its files, …
const CLOSE_TIMEOUT: Duration = Duration::from_millis(100);
/// … and how often is looked whether it has.
const CLOSE_INTERVAL: Duration = Duration::from_millis(2);

impl Server {
    /// Opens something. Where no more files can be opened, the cursors of connections that have ended are closed, one
    /// connection after the other, and it is tried again.
    pub(super) fn with_files<T, E>(&self, open: impl Fn() -> Result<T, E>) -> Result<T, E> {
        let mut is_last = false;
        loop {
            let opened = open();
            if opened.is_ok() || is_last {
                return opened;
            }
            // Another thread may have closed files since it failed.
            is_last = !self.free_files();
        }
    }

    /// Where hardly a file can be opened, closes the cursors of the connection that has ended and was not read for longest;
    /// says whether there was one.
    pub(super) fn free_files(&self) -> bool {
        if !is_short() {
            return false;
        }
        let is_freed = self.cursors.close_connection_left();
        let until = Instant::now() + CLOSE_TIMEOUT;
        while is_freed && is_short() && Instant::now() < until {
            std::thread::sleep(CLOSE_INTERVAL);
        }
        is_freed
    }
}

/// Whether fewer files can be opened than a memory needs.
fn is_short() -> bool {
    let files: Result<Vec<File>, _> = (0..NEEDED).map(|_| File::open(ANY_FILE)).collect();
    files.is_err()
}
