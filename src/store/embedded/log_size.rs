//! The size of the write-ahead log: it grows ahead of what is written.
//!
//! The disk is waited for longer where a commit makes the log longer than where it overwrites a part of it: then the file
//! system has metadata of its own to write. So a process that goes on writing appends zeros to the log, as many as
//! it is long, up to the size at which it is folded into the file anyway, from where on it is used again. SQLite
//! does not read zeros as a part of the log: each frame has the number of a page, which is not 0, and the log's salt
//! (<https://www.sqlite.org/fileformat2.html#walformat>).

use std::cell::Cell;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

/// A log that is shorter, in bytes, is that of a few writes, and is left alone.
const SHORTEST: u64 = 128 << 10;
/// A log of this length, in bytes, has the 1000 pages with which it is folded into the file.
const LONGEST: u64 = 4 << 20;
/// The zeros that are written at once.
static ZEROS: [u8; 64 << 10] = [0; 64 << 10];

/// What is known of the log's length.
#[derive(Debug, Default)]
pub(super) struct LogSize {
    /// In bytes, after the last commit.
    length: Cell<u64>,
    /// Whether the last commit made it longer.
    has_grown: Cell<bool>,
    /// Whether the disk has room for more than what is written.
    is_allowed: Cell<bool>,
}

impl LogSize {
    /// Says whether the disk has room.
    pub(super) fn allow(&self, is_allowed: bool) {
        self.is_allowed.set(is_allowed);
    }

    /// Notes the length of the log. After a commit.
    pub(super) fn measure(&self, log: &Path) {
        let length = length(log).unwrap_or(0);
        self.has_grown.set(length > self.length.replace(length));
    }

    /// Makes the log longer where the last commit did so. At the beginning of a write transaction, before which
    /// nothing was written in it: no other process writes to the log then, nor cuts it.
    pub(super) fn extend(&self, log: &Path) {
        if !self.has_grown.replace(false) || !self.is_allowed.get() {
            return;
        }
        let Ok(log) = OpenOptions::new().write(true).open(log) else { return };
        // A log that cannot be made longer is long enough for what it has.
        if let Ok(length) = extended(&log) {
            self.length.set(length);
        }
    }
}

/// The length of a file, in bytes.
///
/// Nothing else is asked for. Where a file was asked when it was changed, Linux 6.13 and newer note the time of its next
/// write, for which the disk is waited for once more (<https://docs.kernel.org/filesystems/multigrain-ts.html>).
#[cfg(target_os = "linux")]
fn length(file: &Path) -> io::Result<u64> {
    use rustix::fs::{AtFlags, CWD, StatxFlags, statx};
    match statx(CWD, file, AtFlags::empty(), StatxFlags::SIZE) {
        Ok(known) => Ok(known.stx_size),
        // Linux before 4.11 has no such call, and some sandboxes refuse it.
        Err(_) => Ok(file.metadata()?.len()),
    }
}

#[cfg(not(target_os = "linux"))]
fn length(file: &Path) -> io::Result<u64> {
    Ok(file.metadata()?.len())
}

/// Appends zeros to a log, where it is neither short nor long; returns its length.
fn extended(log: &File) -> io::Result<u64> {
    let length = log.metadata()?.len();
    if !(SHORTEST..LONGEST).contains(&length) {
        return Ok(length);
    }
    let end = (length * 2).min(LONGEST);
    append(log, length, end).inspect_err(|_| drop(log.set_len(length)))?;
    Ok(end)
}

fn append(log: &File, mut position: u64, end: u64) -> io::Result<()> {
    while position < end {
        let count = usize::try_from(end - position).unwrap_or(ZEROS.len()).min(ZEROS.len());
        let zeros = ZEROS.get(..count).unwrap_or_default();
        log.write_all_at(zeros, position)?;
        position += zeros.len() as u64;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Embedded, Namespace, Store as _};
    use bson::doc;

    #[test]
    fn the_log_of_a_process_that_goes_on_writing_rarely_grows_and_loses_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let ns = Namespace::parse("a.b").unwrap();
        let stores = [Embedded::open(&path).unwrap(), Embedded::open(&path).unwrap()];
        let log = stores[0].place.log().unwrap();
        let (mut lengths, mut written) = (Vec::new(), 0_i64);
        for (store, count) in [(&stores[0], 300), (&stores[1], 20), (&stores[0], 500)] {
            for _ in 0..count {
                store.insert(&ns, vec![doc! { "_id": written, "text": "x".repeat(500) }]).unwrap();
                written += 1;
                lengths.push(log.metadata().unwrap().len());
            }
        }
        let first = lengths[0];
        lengths.dedup();
        assert!(first < SHORTEST && lengths.iter().all(|length| *length <= LONGEST), "{lengths:?}");
        assert!(lengths.len() < 30, "{} of 820 commits made the log longer", lengths.len() - 1);
        // As if all processes had been killed.
        let copy = folder.path().join("copy.rmem");
        std::fs::copy(&path, &copy).unwrap();
        std::fs::copy(&log, folder.path().join("copy.rmem-wal")).unwrap();
        let copy = Embedded::open(&copy).unwrap();
        assert_eq!(copy.count(&ns, (&doc! {}).into()).unwrap(), written.unsigned_abs());
        assert!(copy.check(&mut |damage| panic!("{damage}")).is_ok());
    }
}
