//! SQLite's errors as errors of a store: what is wrong, where, and what to do.

use rusqlite::{Error, ErrorCode, ffi};

use super::busy::LOCK_TIMEOUT;
use super::place::Place;
use crate::store::StoreError;

/// The message about a full disk.
const DISK_FULL: &str = "the disk is full; make room or delete documents, and repeat: nothing of this write was kept";
/// The same, where there is no room for the log of a deletion.
const NO_ROOM: &str = "the disk is full; remove other files, and repeat: nothing of this write was kept";
/// The same, where documents cannot even be deleted.
const NO_ROOM_TO_DELETE: &str =
    "the disk is full, and a deletion needs a few pages for its log; remove other files, and repeat";
/// The message where a copy does not fit.
const NO_ROOM_TO_COPY: &str = "the disk is full; make room, or name a file on another one";
/// With less than this many bytes, SQLite cannot make the index of its log.
const LEAST: u64 = 64 << 10;

/// Returns the error of a store for one of SQLite.
pub(super) fn explain(place: &Place, error: &Error) -> StoreError {
    let reason = match error.sqlite_error_code() {
        Some(ErrorCode::NotADatabase) => "it is not an rmem memory; name another file".to_owned(),
        Some(ErrorCode::DatabaseCorrupt) => {
            format!(
                "it is damaged ({error}); list the damage with `rmem doctor --deep`, and copy what can be read into a new file with `rmem repair -o FILE`"
            )
        }
        Some(ErrorCode::DiskFull) => return full(place, DISK_FULL),
        Some(ErrorCode::ReadOnly) => {
            "it cannot be written; check the permissions of the file and of its folder".to_owned()
        }
        Some(ErrorCode::PermissionDenied) => "permission denied; check the file's owner and mode".to_owned(),
        Some(ErrorCode::CannotOpen | ErrorCode::SystemIoFailure) if is_full(place) => return no_room(place),
        Some(ErrorCode::CannotOpen) => return unreachable(place, cannot_open(place)),
        Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => {
            format!("another process has been writing for {} s; end it or try again", LOCK_TIMEOUT.as_secs())
        }
        Some(ErrorCode::TooBig) => "the document is too large for the file".to_owned(),
        Some(ErrorCode::SystemIoFailure) => format!("reading or writing failed ({error}); check the disk"),
        _ => error.to_string(),
    };
    StoreError::Failed { address: place.to_string(), reason }
}

/// Damage that SQLite does not notice.
pub(super) fn damage(what: &str) -> Error {
    Error::SqliteFailure(ffi::Error::new(ffi::SQLITE_CORRUPT), Some(what.to_owned()))
}

/// That an entry of an index is not as it was written.
pub(super) fn entry() -> Error {
    damage("an index has a changed key")
}

/// That an index lists a document that is not there.
pub(super) fn no_document() -> Error {
    damage("an index lists a document that is not there")
}

/// Refuses a document that does not come behind the one before it: a page that is another one's copy would be read
/// again and again.
pub(super) fn check_order(position: i64, before: i64) -> Result<(), Error> {
    if position > before { Ok(()) } else { Err(damage("its documents are out of order")) }
}

/// Whether SQLite found the file damaged.
pub(super) fn is_damage(error: &Error) -> bool {
    error.sqlite_error_code() == Some(ErrorCode::DatabaseCorrupt)
}

/// Whether the file is none of SQLite.
pub(super) fn is_no_database(error: &Error) -> bool {
    error.sqlite_error_code() == Some(ErrorCode::NotADatabase)
}

/// Whether there was no room on the disk.
pub(super) fn is_full_disk(error: &Error) -> bool {
    error.sqlite_error_code() == Some(ErrorCode::DiskFull)
}

fn unreachable(place: &Place, reason: String) -> StoreError {
    StoreError::unreachable(place.to_string(), reason)
}

/// Whether the file system of the store has no space left: SQLite reports then that it cannot make
/// or write its log.
fn is_full(place: &Place) -> bool {
    let Some(folder) = place.folder() else { return false };
    rustix::fs::statvfs(folder).is_ok_and(|system| {
        let room = system.f_bavail.saturating_mul(system.f_frsize);
        system.f_blocks > 0 && room < LEAST || (system.f_favail == 0 && system.f_files > 0)
    })
}

fn full(place: &Place, reason: &str) -> StoreError {
    StoreError::DiskFull { address: place.to_string(), reason: reason.to_owned() }
}

/// That the disk is full.
pub(super) fn disk_full(place: &Place) -> StoreError {
    full(place, if is_full(place) { NO_ROOM } else { DISK_FULL })
}

/// That the disk is full, where nothing can be deleted.
pub(super) fn no_room(place: &Place) -> StoreError {
    full(place, NO_ROOM)
}

/// That the disk is full, where something was to be deleted.
pub(super) fn no_room_to_delete(place: &Place) -> StoreError {
    full(place, NO_ROOM_TO_DELETE)
}

/// The error where a memory is copied into a new file.
pub(super) fn explain_copy(place: &Place, error: &Error) -> StoreError {
    match explain(place, error) {
        StoreError::DiskFull { .. } => full(place, NO_ROOM_TO_COPY),
        other => other,
    }
}

/// An error of a file that gets its name at the end, said of that name.
pub(super) fn of_copy(place: &Place, error: StoreError) -> StoreError {
    let address = place.to_string();
    match error {
        StoreError::DiskFull { .. } => full(place, NO_ROOM_TO_COPY),
        StoreError::Failed { reason, .. } => StoreError::Failed { address, reason },
        StoreError::Unreachable { reason, may_be_done, .. } => StoreError::Unreachable { address, reason, may_be_done },
        other => other,
    }
}

/// Describes an error of the file system where a memory is copied.
pub(super) fn io(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => NO_ROOM_TO_COPY.to_owned(),
        _ => error.to_string(),
    }
}

/// Finds out from the file system why SQLite could not open the file.
fn cannot_open(place: &Place) -> String {
    let Place::File(path) = place else { return "out of memory".to_owned() };
    if let Err(error) = std::fs::File::open(path)
        && let Some(error) = rustix::io::Errno::from_io_error(&error)
        && matches!(error, rustix::io::Errno::MFILE | rustix::io::Errno::NFILE)
    {
        return format!("{error}; raise the limit on open files (ulimit -n)");
    }
    if path.is_dir() {
        return "it is a directory; name a file in it".to_owned();
    }
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => std::path::Path::new("."),
    };
    match std::fs::metadata(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            format!("its folder {} does not exist; create it first", folder.display())
        }
        Err(error) => format!("its folder {} cannot be used: {error}", folder.display()),
        Ok(kind) if !kind.is_dir() => format!("{} is not a folder", folder.display()),
        Ok(_) => "no permission to open or create it; check the file's and the folder's permissions".to_owned(),
    }
}

/// Whether a statement failed because its table is gone: another process dropped the collection.
pub(super) fn is_gone(error: &Error) -> bool {
    matches!(error, Error::SqliteFailure(_, Some(message)) if message.starts_with("no such table"))
        || matches!(error, Error::SqlInputError { msg, .. } if msg.starts_with("no such table"))
}

/// Whether a statement failed because a unique key is taken.
pub(super) fn is_duplicate(error: &Error) -> bool {
    matches!(error.sqlite_error(), Some(ffi::Error { extended_code: ffi::SQLITE_CONSTRAINT_UNIQUE, .. }))
}
