//! Room on the disk: what grows the file ends while deleting still helps.
//!
//! SQLite needs room in its log for every write, also for one that deletes. So the log is folded into the file and cut
//! before each write where the disk is nearly full, and a last part of the disk is for deleting only.

use std::path::PathBuf;

use rustix::fs::statvfs;

use super::place::Place;
use super::{Embedded, failure};
use crate::store::{Store as _, StoreError};

/// With less than this many bytes, the disk is nearly full: twice the size at which the log is folded into the file anyway.
const LITTLE: u64 = 8 << 20;
/// With this many bytes, the log may be longer than what is in it.
const AMPLE: u64 = 256 << 20;
/// What is left for deleting, in bytes; on a small disk an eighth of it.
const RESERVE: u64 = 1 << 20;

/// While it lives, what is written deletes.
pub(super) struct Deleting<'a>(&'a Embedded);

impl Drop for Deleting<'_> {
    fn drop(&mut self) {
        self.0.is_deleting.set(false);
    }
}

impl Embedded {
    /// Says that what is written until the guard goes makes room.
    pub(super) fn deleting(&self) -> Deleting<'_> {
        self.is_deleting.set(true);
        Deleting(self)
    }

    /// Whether what is written makes room.
    pub(super) fn is_deleting(&self) -> bool {
        self.is_deleting.get()
    }

    /// Whether the disk is nearly full, so that a write should be small.
    pub(super) fn is_crowded(&self) -> bool {
        self.is_crowded.get()
    }

    /// Cuts the log where the disk is nearly full, and refuses to write what grows the file where the reserve has begun.
    /// Outside of a transaction. Where the last write left much room, it is not asked for again.
    pub(super) fn make_room(&self) -> Result<(), StoreError> {
        if !self.is_crowded.get() {
            return Ok(());
        }
        let Some((room, _)) = room_of(&self.place).filter(|(room, _)| *room < LITTLE) else {
            self.is_crowded.set(false);
            return Ok(());
        };
        // Another process may read the log; then it is cut another time.
        let _ = self.fold();
        if self.is_deleting() {
            return Ok(());
        }
        let (room, size) = room_of(&self.place).unwrap_or((room, u64::MAX));
        self.spare_reserve(room, size)
    }

    /// Refuses a write that would leave less than the reserve, unless it deletes. Before its commit.
    pub(super) fn keep_room(&self) -> Result<(), StoreError> {
        let room = room_of(&self.place);
        let little = room.filter(|(room, _)| *room < LITTLE);
        self.is_crowded.set(little.is_some());
        self.log_size.allow(room.is_some_and(|(room, _)| room >= AMPLE));
        let Some((room, size)) = little.filter(|_| !self.is_deleting()) else { return Ok(()) };
        let length = |path: Option<PathBuf>| path.and_then(|path| path.metadata().ok()).map_or(0, |file| file.len());
        let grown = self.bytes("PRAGMA page_count").saturating_sub(length(self.place.file()));
        let without_log = room.saturating_add(length(self.place.log()));
        // While the log is folded into the file, new pages are in both. Were there no room for that, the log would
        // stay, and with it no room to delete anything.
        if grown > 0 && without_log.saturating_sub(grown * 2) < reserve_of(size) {
            return Err(failure::disk_full(&self.place));
        }
        self.spare_reserve(without_log.saturating_sub(grown), size)
    }

    /// Refuses to take from the reserve. `room` bytes of a file system of `size` are free, and so
    /// are the pages of the file that hold nothing.
    fn spare_reserve(&self, room: u64, size: u64) -> Result<(), StoreError> {
        match room.saturating_add(self.bytes("PRAGMA freelist_count")) >= reserve_of(size) {
            true => Ok(()),
            false => Err(failure::disk_full(&self.place)),
        }
    }

    /// The bytes of a number of pages.
    fn bytes(&self, count: &str) -> u64 {
        let number = |pragma: &str| self.connection.query_row(pragma, [], |row| row.get::<_, i64>(0));
        let bytes = number(count).and_then(|count| number("PRAGMA page_size").map(|size| count.saturating_mul(size)));
        bytes.ok().and_then(|bytes| u64::try_from(bytes).ok()).unwrap_or_default()
    }
}

/// What is left for deleting on a file system of so many bytes.
fn reserve_of(size: u64) -> u64 {
    RESERVE.min(size / 8)
}

/// The free bytes of the file system, and all of them; nothing where there is no file system with a size.
fn room_of(place: &Place) -> Option<(u64, u64)> {
    let system = statvfs(place.folder()?).ok().filter(|system| system.f_blocks > 0)?;
    Some((system.f_bavail.saturating_mul(system.f_frsize), system.f_blocks.saturating_mul(system.f_frsize)))
}
